// Colours as bytes, and the colour maps of continuous quantities.

const parts = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
const packed = ([r, g, b]) => (255 << 24 | b << 16 | g << 8 | r) >>> 0;
const unit = (hex) => parts(hex).map((part) => part / 255);

// 256 packed colours along the stops of a map.
function ramp(stops) {
  const colours = stops.map(parts);
  return Uint32Array.from({ length: 256 }, (_, k) => {
    const place = k / 255 * (colours.length - 1);
    const below = Math.min(Math.floor(place), colours.length - 2);
    return packed(colours[below].map((part, i) => part + (place - below) * (colours[below + 1][i] - part)));
  });
}

const gradient = (stops) => `linear-gradient(to right, ${stops.join(", ")})`;

// Colours as bytes, and the colour maps of continuous quantities.

const parts = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
const packed = ([r, g, b]) => (255 << 24 | b << 16 | g << 8 | r) >>> 0;
const unit = (hex) => parts(hex).map((part) => part / 255);

// A scale of densities with levels of service as colours; other scales as they are.
function served(scale, service, services) {
  if (scale?.unit !== "1/m²") return scale;
  const { edges, letters } = services[service] ?? {};
  return { ...scale, isDensity: true, ...(edges && { edges, letters, top: 5, isVeiled: false }) };
}

// Where a value is on a scale, from 0 to 1.
const shareOf = ({ least, isLogarithmic }, top, value) => Math.max(0, Math.min(1, isLogarithmic ? Math.log(value / least) / Math.log(top / least) : value / top));

// 256 packed colours along the stops of a scale, or of its levels of service.
function ramp({ stops, edges, top }) {
  const colours = stops.map(parts);
  return Uint32Array.from({ length: 256 }, (_, k) => {
    const band = edges && edges.filter((edge) => edge <= top * k / 255).length / edges.length;
    const place = (band ?? k / 255) * (colours.length - 1);
    const below = Math.min(Math.floor(place), colours.length - 2);
    return packed(colours[below].map((part, i) => part + (place - below) * (colours[below + 1][i] - part)));
  });
}

// The same map for a layer on a floor, which shows through where there is nothing, or little; at the end of the scale, too, if that is open.
const veil = (share) => 0.92 * Math.min(1, share / 0.4) ** 0.8;
const cover = (share) => share > 0 ? 0.92 : 0;
const layered = (colours, isVeiled, isOpen) => colours.map((colour, k) => (colour & 0xffffff | (isOpen && k === 255 ? 0 : Math.round(255 * (isVeiled ? veil : cover)(k / 255))) << 24) >>> 0);
const onFloor = (scale, floor) => {
  const colours = ramp(scale), { isVeiled } = scale;
  return Array.from({ length: 65 }, (_, k) => {
    const colour = colours[Math.round(255 * k / 64)], share = (isVeiled ? veil : cover)(k / 64 + (isVeiled ? 0 : 1e-3));
    return `rgb(${[0, 8, 16].map((bits, i) => Math.round(share * (colour >> bits & 255) + (1 - share) * 255 * floor[i]))})`;
  });
};

const gradient = (stops) => `linear-gradient(to right, ${stops.join(", ")})`;

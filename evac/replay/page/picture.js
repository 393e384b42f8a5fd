// A picture of what is shown, with labels, time and legend: to save, and for print.

const LINE = 20;  // Height of a line of the legend [pixels of the page].

// Paints what the stage has just drawn below the tools, and the texts, on a canvas of its own, or on one that has its size already.
function paintPicture(canvas, { labels, title, about, legend, top }, page = document.createElement("canvas")) {
  const pixels = canvas.width / canvas.clientWidth, ratio = page.ratio ??= pixels, pen = page.getContext("2d");
  const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(`--${name}`);
  const small = `12px ${getComputedStyle(document.body).fontFamily}`, high = canvas.clientHeight - top;
  pen.font = small;
  const parts = arrangeLegend(pen, legend, canvas.clientWidth - 12);
  if (!page.isSized) Object.assign(page, { isSized: true, width: even(canvas.width), height: even((high + LINE * (parts.at(-1).line + 3)) * ratio) });
  pen.resetTransform();
  pen.fillStyle = colour("panel");
  pen.fillRect(0, 0, page.width, page.height);
  pen.scale(ratio, ratio);
  pen.drawImage(canvas, 0, top * pixels, canvas.width, high * pixels, 0, 0, canvas.clientWidth, high);
  pen.textBaseline = "middle";
  for (const { span, box: [left, low, right, bottom], line: [x1, y1, x2, y2] } of labels) {
    const { backgroundColor, color, font } = getComputedStyle(span);
    Object.assign(pen, { fillStyle: backgroundColor, strokeStyle: colour("text"), font });
    pen.beginPath();
    pen.moveTo(x1, y1 - top);
    pen.lineTo(x2, y2 - top);
    pen.stroke();
    pen.beginPath();
    pen.roundRect(left, low - top, right - left, bottom - low, 8);
    pen.fill();
    pen.fillStyle = color;
    pen.fillText(span.textContent, left + 7, (low + bottom) / 2 - top);
  }
  Object.assign(pen, { fillStyle: colour("text"), font: `600 14px ${small.slice(5)}` });
  pen.fillText([about, title].filter(Boolean).join(" · "), 12, high + LINE);
  for (const { x, line, stops, width, text } of parts) {
    const y = high + LINE * (line + 2);
    const ramp = pen.createLinearGradient(...(width > SWATCH ? [x, 0, x + width, 0] : [0, y - 7, 0, y + 7]));
    for (const [at, stop] of stops) ramp.addColorStop(at, stop);
    Object.assign(pen, { fillStyle: ramp, strokeStyle: colour("edge"), font: small });
    pen.fillRect(x, y - 7, width, 14);
    pen.strokeRect(x, y - 7, width, 14);
    pen.fillStyle = colour("text");
    pen.fillText(text, x + width + 6, y);
  }
  return page;
}

const SWATCH = 9;  // Width of what stands for a group [pixels].

// Place, colours and text of each entry: groups, from head to foot; or a scale and what is below it.
function arrangeLegend(pen, { groups, scale }, right) {
  const plain = (colour) => [[0, colour], [1, colour]];
  const entries = scale
    ? [{ width: 160, stops: scale.stops.map((stop, k) => [k / (scale.stops.length - 1), stop]), text: `${scale.name}, ${scale.isLogarithmic ? scale.least : 0} to ${scale.most} ${scale.unit}` },
       ...(scale.below ? [{ width: SWATCH, stops: plain(scale.nothing), text: scale.below }] : [])]
    : groups.map(({ name, look: [body, head, belt] }) => ({ width: SWATCH, text: name,
      stops: [[head, 0, 0.34], [body, 0.34, 0.56], [belt, 0.56, 0.76], [body, 0.76, 1]].flatMap(([colour, from, to]) => [[from, colour], [to, colour]]) }));
  let x = 12, line = 0;
  return entries.map((entry) => {
    const wide = entry.width + pen.measureText(entry.text).width + 18;
    if (x + wide > right && x > 12) [x, line] = [12, line + 1];
    return { ...entry, line, x: (x += wide) - wide };
  });
}

const even = (length) => 2 * Math.round(length / 2);  // As videos need it.
const FILMS = ["video/mp4;codecs=avc1.640028", "video/webm;codecs=vp9", "video/webm"];
const BITS_PER_SECOND = 8e6;

// Records what is painted on a page from now on, until `end` saves it; null where the browser cannot.
function startFilm(page, name) {
  const type = FILMS.find((one) => window.MediaRecorder?.isTypeSupported(one)), chunks = [];
  if (!type) return null;
  const recorder = new MediaRecorder(page.captureStream(), { mimeType: type, videoBitsPerSecond: BITS_PER_SECOND });
  recorder.addEventListener("dataavailable", ({ data }) => chunks.push(data));
  recorder.addEventListener("stop", () => save(new Blob(chunks, { type }), `${name}.${/mp4|webm/.exec(type)[0]}`));
  recorder.start();
  return { page, end: () => recorder.stop() };
}

function savePicture(page, name) {
  page.toBlob((blob) => save(blob, name), "image/png");
}

function save(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

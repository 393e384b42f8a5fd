// A picture of what is shown, with labels, time and legend: to save, and for print.

const FOOT = 64;  // Height of the strip below the picture [pixels of the page].

// Paints what the stage has just drawn, and the texts, on a canvas of its own.
function paintPicture(canvas, title, about, legend) {
  const ratio = canvas.width / canvas.clientWidth, page = document.createElement("canvas"), pen = page.getContext("2d");
  const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(`--${name}`);
  Object.assign(page, { width: canvas.width, height: canvas.height + Math.ceil(FOOT * ratio) });
  pen.fillStyle = colour("panel");
  pen.fillRect(0, 0, page.width, page.height);
  pen.drawImage(canvas, 0, 0);
  pen.scale(ratio, ratio);
  pen.textBaseline = "middle";
  const origin = canvas.getBoundingClientRect();
  for (const span of by("labels").children) {
    if (span.style.visibility !== "visible") continue;
    const box = span.getBoundingClientRect(), { backgroundColor, color, font } = getComputedStyle(span);
    pen.fillStyle = backgroundColor;
    pen.beginPath();
    pen.roundRect(box.x - origin.x, box.y - origin.y, box.width, box.height, 8);
    pen.fill();
    Object.assign(pen, { fillStyle: color, font });
    pen.fillText(span.textContent, box.x - origin.x + 7, box.y - origin.y + box.height / 2);
  }
  const top = canvas.clientHeight, family = getComputedStyle(document.body).fontFamily;
  pen.fillStyle = colour("text");
  pen.font = `600 14px ${family}`;
  pen.fillText([about, title].filter(Boolean).join(" · "), 12, top + 18);
  pen.font = `12px ${family}`;
  paintLegend(pen, legend, top + 42, canvas.clientWidth - 12, colour("text"));
  return page;
}

// Swatches with names, as many as fit; or a scale with its ends.
function paintLegend(pen, { groups, scale }, y, right, ink) {
  let x = 12;
  const write = (text) => { pen.fillStyle = ink; pen.fillText(text, x, y); x += pen.measureText(text).width + 6; };
  if (scale) {
    write(`${scale.name}: ${scale.least}`);
    const ramp = pen.createLinearGradient(x, 0, x + 160, 0);
    scale.stops.forEach((stop, k) => ramp.addColorStop(k / (scale.stops.length - 1), stop));
    pen.fillStyle = ramp;
    pen.fillRect(x, y - 6, 160, 12);
    x += 166;
    write(`${scale.most} ${scale.unit}`);
    if (!scale.below) return;
    x += 12;
    pen.fillStyle = scale.nothing;
    pen.fillRect(x, y - 5, 10, 10);
    x += 14;
    write(scale.below);
    return;
  }
  for (const [k, { name, look: [body, head, belt] }] of groups.entries()) {
    if (x + pen.measureText(name).width + 90 > right) return write(`and ${groups.length - k} more groups`);
    for (const [part, from, high] of [[body, -7, 14], [head, -7, 5], [belt, 1, 3]]) {
      pen.fillStyle = part;
      pen.fillRect(x, y + from, 9, high);
    }
    x += 14;
    write(name);
    x += 6;
  }
}

function savePicture(page, name) {
  page.toBlob((blob) => save(blob, name), "image/png");
}

function save(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

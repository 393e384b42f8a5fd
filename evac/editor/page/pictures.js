// Pictures of plans under storeys: chosen or dropped, moved, and scaled by two points and the length between them.

const IMAGES = ["image/png", "image/jpeg"];

class Pictures {
  constructor(view, store, act) {
    Object.assign(this, { view, store, act, all: {}, points: null, last: null });
    const place = (change) => ({ target: { valueAsNumber: value } }) => { if (Number.isFinite(value) && this.own) this.put(change(this.own, value)); };
    by("picture-file").addEventListener("change", ({ target }) => { this.take(target.files[0]); target.value = ""; });
    by("picture-left").addEventListener("change", place(({ at: [, y] }, x) => ({ at: [x, y] })));
    by("picture-bottom").addEventListener("change", place(({ at: [x] }, y) => ({ at: [x, y] })));
    by("picture-width").addEventListener("change", place((_, width) => width > 0 ? { width } : {}));
    by("picture-length").addEventListener("change", ({ target }) => this.scale(target.valueAsNumber));
    by("picture-shown").addEventListener("change", () => view.draw());
    by("picture-remove").addEventListener("click", () => this.remove());
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => { event.preventDefault(); this.take(event.dataTransfer.files[0]); });
    this.load();
  }

  // The name of the storey whose picture is under the one that is shown: its own, or one that it is like.
  get name() { return [this.view.storey, ...this.store.now.originals(this.view.storey)].find((name) => this.all[name]); }
  get own() { return this.all[this.name]; }
  get isShown() { return Boolean(this.own) && by("picture-shown").checked; }

  async load() {
    for (const [name, { data, at, width }] of Object.entries(await ask("pictures"))) this.all[name] = { at, width, ...await bitmapOf(data) };
    this.show();
  }

  async take(file) {
    if (!file) return;
    if (!IMAGES.includes(file.type)) return this.act.warn(`${file.name}: is no PNG or JPEG; a building file is imported by evac edit without an argument`);
    try {
      const data = await base64Of(file), made = await bitmapOf(data), { view } = this, [w, h] = view.size, corners = view.levels().flatMap(({ polygons }) => polygons.flat(2));
      const low = corners.length ? [0, 1].map((i) => range(corners, (corner) => corner[i])[0]) : view.place(0.15 * w, 0.85 * h), width = corners.length ? range(corners, ([x]) => x)[1] - low[0] : 0.7 * w / view.zoom;
      this.all[view.storey] = made;
      this.put({ data, at: low.map(mm), width: mm(width) });
      by("picture-shown").checked = true;
      this.act.choose("picture");
    } catch (error) {
      this.act.warn(`${file.name}: ${error.message}`);
    }
  }

  // Changes where the picture is, and has it kept.
  async put(change) {
    const { name } = this, { data, ...place } = change;
    Object.assign(this.all[name], place);
    this.show();
    const { at, width } = this.all[name], order = { storey: name, picture: { at, width, ...(data ? { data } : {}) } };
    try {
      this.last = Promise.resolve(this.last).catch(() => null).then(() => ask("picture", order));  // One after the other.
      await this.last;
    } catch (error) {
      this.act.warn(error.message);
    }
  }

  async remove() {
    const { name } = this;
    delete this.all[name];
    this.show();
    await ask("picture", { storey: name, picture: null });
  }

  // The picture of a storey that has another name now; that of the old one stays, for undo.
  async rename(old, name) {
    if (!this.all[old]) return;
    const { [old]: { data, at, width } } = await ask("pictures");
    this.all[name] = { ...this.all[old] };
    await ask("picture", { storey: name, picture: { data, at, width } });
    this.show();
  }

  // Two points of the picture, between which a length is to be typed.
  measure(points) {
    this.points = points;
    this.show();
    this.act.say("Type the length between the two points");
    by("picture-length").focus();
  }

  // Scales the picture about the first point, so that the two points are so far from each other.
  scale(far) {
    const [a, b] = this.points, factor = far / length(minus(b, a));
    if (!(factor > 0) || !Number.isFinite(factor)) return;
    const { at, width } = this.own;
    this.points = null;
    this.act.measured(null);
    this.put({ at: at.map((value, i) => mm(a[i] + (value - a[i]) * factor)), width: mm(width * factor) });
    this.act.say(`The picture is ${(width * factor).toFixed(2)} m wide`);
    this.view.canvas.focus();
  }

  show() {
    const { own } = this;
    by("picture-box").hidden = !own;
    by("picture-scale").hidden = !this.points;
    if (own) [by("picture-left").value, by("picture-bottom").value, by("picture-width").value] = [...own.at, own.width];
    by("picture-length").value = "";
    this.view.draw();
  }

  paint(pen) {
    const { bitmap, at: [x, y], width } = this.own, height = width * bitmap.height / bitmap.width;
    pen.save();
    pen.translate(x, y + height);
    pen.scale(1, -1);
    pen.globalAlpha = 0.75;
    pen.drawImage(bitmap, 0, 0, width, height);
    pen.restore();
  }
}

async function bitmapOf(data) {
  const bytes = Uint8Array.from(atob(data), (sign) => sign.charCodeAt(0));
  return { bitmap: await createImageBitmap(new Blob([bytes])) };
}

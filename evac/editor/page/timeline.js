// Events and phases along the time of a run: each is a button that is clicked, dragged, or moved by the arrows.

const LEAST_END = 120, ROOM = 1.25;  // Least end of the axis [s], and how far it goes beyond the last time.
const LANE = 1.75, MOST_LANES = 4;  // Height of a lane [rem], and how many are seen at once.
const SIGN = 7;  // Width of a letter, about [pixels].
const DATED = ["event", "phase"];

class Timeline {
  constructor(store, act) {
    Object.assign(this, { store, act, drag: null });
    by("timeline").hidden = false;
  }

  get table() { return this.store.now; }

  rows() { return DATED.flatMap((section) => this.table.rows(section).map((row, index) => ({ ref: { section, index }, row }))); }

  // The name of what a row waits for, and the key of the time after that; an event at a time waits for the start.
  cueOf({ section }, row) {
    if (section === "phase") return { cue: row.cue, key: "delay", after: row.delay ?? 0 };
    if (row.time !== undefined) return { key: "time", after: row.time };
    return { cue: row.when?.event, key: row.when?.event === undefined ? null : "when", after: row.when?.after ?? 0 };
  }

  // When something happens [s]; null if this is not known before the run.
  timeOf({ ref, row }, seen = []) {
    const { cue, key, after } = this.cueOf(ref, row);
    if (!key || seen.includes(row)) return null;
    if (cue === undefined) return after;
    const before = this.rows().find((one) => one.row.name === cue), start = before ? this.timeOf(before, [...seen, row]) : null;
    return start === null ? null : start + after;
  }

  // Puts something at a time; not before what it waits for.
  put({ ref, row }, time, name) {
    const { key, after } = this.cueOf(ref, row), next = Math.max(0, Math.round(after + time - this.timeOf({ ref, row })));
    if (next === after) return;
    this.store.commit(this.table.put(ref, key, key === "when" ? { ...row.when, after: next } : next), name);
  }

  show(selected) {
    const all = this.rows().map((one) => ({ ...one, time: this.timeOf(one) })), known = all.filter(({ time }) => time !== null).sort((a, b) => a.time - b.time), box = by("timeline");
    if (!this.drag) this.end = Math.max(LEAST_END, ROOM * (known.at(-1)?.time ?? 0));
    const axis = node("div", "", { className: "axis" }), lanes = [], wide = box.clientWidth || 800;
    for (const tick of ticks(this.end, 8)) if (tick < 0.95 * this.end) axis.append(this.placed(node("span", `${tick} s`), tick));
    const marks = [...known, ...all.filter(({ time }) => time === null)].map((one) => {
      const { ref, row, time } = one, words = [ref.section === "event" ? [row.kind, row.target].filter(Boolean).join(" ") : `${row.name}: ${[row.of].flat().join(", ")}`, time === null ? "when its cue comes" : `${time} s`].join(", ");
      const button = node("button", "", { type: "button", className: ref.section, title: "Drag it, or move it with the arrows: 1 s, with Shift 10 s" }), at = (time ?? this.end) / this.end * wide, size = SIGN * words.length + 30, left = Math.min(at, wide - size);
      const lane = [...lanes, -Infinity].findIndex((until) => until < left);
      lanes[lane] = left + size;
      button.append(node("span", words));
      button.setAttribute("aria-pressed", selected?.section === ref.section && selected.index === ref.index);
      button.style.top = `${lane * LANE + 1.3}rem`;
      button.classList.toggle("late", left < at);
      button.addEventListener("click", () => this.act.select(ref));
      if (time !== null) this.listen(button, one, wide);
      return this.placed(button, time ?? this.end);
    });
    box.style.height = `${Math.min(MOST_LANES, Math.max(1, lanes.length)) * LANE + 1.6}rem`;
    refill(box, [axis, ...marks]);
    box.classList.toggle("empty", !all.length);
    if (!all.length) axis.append(node("em", "Events and phases appear here, at their times"));
  }

  placed(element, time) {
    element.style.left = `${100 * time / this.end}%`;
    return element;
  }

  listen(button, one, wide) {
    const name = `time ${JSON.stringify(one.ref)}`;
    button.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!by) return;
      event.preventDefault();
      this.put(one, one.time + by * (event.shiftKey ? 10 : 1), name);
    });
    button.addEventListener("pointerdown", ({ clientX, pointerId }) => {
      button.setPointerCapture(pointerId);
      this.drag = { from: clientX, time: one.time };
    });
    button.addEventListener("pointermove", ({ clientX }) => {
      if (!this.drag || Math.abs(clientX - this.drag.from) < DRAGGED) return;
      this.drag.time = Math.max(0, Math.round(one.time + (clientX - this.drag.from) * this.end / wide));
      this.placed(button, this.drag.time);
      this.act.say(`${this.drag.time} s`);
    });
    const end = () => {
      const { time } = this.drag ?? one;
      this.drag = null;
      this.put(one, time);
    };
    button.addEventListener("pointerup", end);
    button.addEventListener("pointercancel", end);
  }
}

// The chart: curves over time, with a cursor at the time that is shown.

const CHART = { width: 320, height: 150, left: 38, right: 8, top: 8, bottom: 24 };
const SAMPLES = 240;

class Chart {
  constructor(node, record, series, seek) {
    Object.assign(this, { node, record, series, seek });
    const at = (times) => (time) => countUpTo(times, time);
    const named = (list, values) => list.map((one) => ({ name: one.name, value: values(one) }));
    this.curves = {
      "people out": [{ name: "all", value: at(series.out), isTotal: true }, ...(series.exits.length > 1 ? named(series.exits, (one) => at(one.times)) : [])],
      "entered each stair": named(series.stairs, (one) => at(one.entered)),
      "on each stair": named(series.stairs, (one) => (time) => one.inside.at(time)),
      "on each level": named(series.storeys, (one) => (time) => one.inside.at(time)),
    };
    for (const [name, curves] of Object.entries(this.curves)) if (!curves.length) delete this.curves[name];
    const pick = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      const box = node.firstChild.getBoundingClientRect();
      const share = ((event.clientX - box.left) / box.width * CHART.width - CHART.left) / (CHART.width - CHART.left - CHART.right);
      this.seek(record.begin + Math.max(0, Math.min(1, share)) * (record.end - record.begin));
    };
    for (const type of ["pointerdown", "pointermove"]) node.addEventListener(type, pick);
  }

  x(time) {
    const { begin, end } = this.record;
    return CHART.left + (CHART.width - CHART.left - CHART.right) * (end > begin ? (time - begin) / (end - begin) : 0);
  }

  show(name) {
    const curves = this.curves[name], { begin, end } = this.record;
    const times = Array.from({ length: SAMPLES + 1 }, (_, k) => begin + (end - begin) * k / SAMPLES);
    const values = curves.map((curve) => times.map(curve.value));
    const most = values.flat().reduce((a, b) => Math.max(a, b), 1), marks = ticks(most, 4), top = Math.max(most, marks.at(-1));
    const y = (value) => CHART.height - CHART.bottom - (CHART.height - CHART.top - CHART.bottom) * value / top;
    const parts = [];
    for (const tick of marks) {
      parts.push(`<line class="grid" x1="${CHART.left}" x2="${CHART.width - CHART.right}" y1="${y(tick)}" y2="${y(tick)}"/>`,
                 `<text x="${CHART.left - 5}" y="${y(tick) + 4}" text-anchor="end">${tick}</text>`);
    }
    const label = (time, text, anchor) => parts.push(`<text class="at" x="${this.x(time)}" y="${CHART.height - 7}" text-anchor="${anchor}">${text}</text>`);
    for (const tick of ticks(end - begin, 5)) if (tick < 0.85 * (end - begin)) label(begin + tick, begin + tick, "middle");
    label(end, `${Number(end.toFixed(1))} s`, "end");
    curves.forEach((curve, index) => {
      const points = times.map((time, k) => `${this.x(time).toFixed(1)},${y(values[index][k]).toFixed(1)}`);
      const isFirstTotal = curves[0].isTotal, style = curve.isTotal ? "" : ` style="${lineStyle(isFirstTotal ? index - 1 : index)}"`;
      parts.push(`<polyline class="curve${curve.isTotal ? " total" : ""}"${style} points="${points.join(" ")}"/>`);
    });
    parts.push(`<line class="cursor" y1="${CHART.top - 4}" y2="${CHART.height - CHART.bottom}"/>`);
    const words = `${name} over time, up to ${most} people in ${(end - begin).toFixed(1)} seconds`;
    this.node.innerHTML = `<svg viewBox="0 0 ${CHART.width} ${CHART.height}" role="img" aria-label="${words}">${parts.join("")}</svg>`;
    this.cursor = this.node.querySelector(".cursor");
  }

  update(time) {
    this.cursor.setAttribute("x1", this.x(time));
    this.cursor.setAttribute("x2", this.x(time));
  }
}

// Round numbers from 0 up to a greatest value, and the next one if that is nearer than half a step.
function ticks(most, count) {
  const power = 10 ** Math.floor(Math.log10(Math.max(most, 1) / count));
  const step = Math.max(1, [1, 2, 5, 10].map((k) => k * power).find((value) => most / value <= count));
  return Array.from({ length: Math.round(most / step) + 1 }, (_, k) => k * step);
}

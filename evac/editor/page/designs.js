// Designs: their runs with many seeds, and two or more of them beside each other.

const HEADS = ["design", "measure", "first [s]", "design [s]", "difference [s], 95 % interval", "verdict"];

class Designs {
  constructor(act) {
    Object.assign(this, { act, all: [], chosen: new Set(), isOn: false });
    by("make-runs").addEventListener("submit", (event) => { event.preventDefault(); this.make(); });
    by("compare").addEventListener("click", () => this.compare());
    by("designs-box").hidden = false;
  }

  // Runs are made of the file: what is drawn is saved first.
  async make() {
    if (!this.isOn && !await this.act.save()) return;
    try {
      const order = this.isOn ? ["stop-runs", {}] : ["repeat", { name: by("design-name").value.trim(), runs: by("design-runs").valueAsNumber }];
      this.show((await ask(...order)).designs);
    } catch (error) {
      this.act.warn(error.message);
    }
  }

  show({ designs, making, failed = "" }) {
    const isNew = ({ name }) => !this.all.some((one) => one.name === name), names = designs.map(({ name }) => name);
    if (this.isOn) for (const { name } of designs.filter(isNew)) this.chosen.add(name);
    Object.assign(this, { all: designs, isOn: Boolean(making), chosen: new Set([...this.chosen].filter((name) => names.includes(name))) });
    const free = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].find((name) => !names.includes(name)) ?? "";
    if (!this.isOn && (!by("design-name").value || names.includes(by("design-name").value))) by("design-name").value = free;
    by("make-button").textContent = this.isOn ? "Stop" : "Make runs";
    by("making").textContent = making ?? failed;
    by("making").className = failed ? "error" : "";
    by("compare").disabled = this.chosen.size < 2;
    refill(by("designs"), designs.map(({ name, runs, text }) => {
      const item = document.createElement("li"), label = document.createElement("label"), box = node("input", "", { type: "checkbox", checked: this.chosen.has(name) });
      box.addEventListener("change", () => { if (box.checked) this.chosen.add(name); else this.chosen.delete(name); by("compare").disabled = this.chosen.size < 2; });
      label.append(box, node("span", `${name}: ${runs}, ${text}`));
      item.append(label);
      return item;
    }));
  }

  async compare() {
    try {
      this.showCompared(await ask("compare", { designs: [...this.chosen] }));
      by("compared").showModal();
    } catch (error) {
      this.act.warn(error.message);
    }
  }

  // A curve of each design on the same axes, and the differences from the first one.
  showCompared({ names, designs, differences, time, curves, people }) {
    by("curves").replaceChildren(...designs.map(({ verdict, status, out }, k) => {
      const figure = document.createElement("figure"), words = `People out over time in ${names[k]}: mean of the runs, and a band from 5 to 95 % of them${k ? "; dashed the mean of " + names[0] : ""}`;
      figure.append(node("h3", names[k]), node("p", verdict, { className: status }), node("p", out));
      figure.insertAdjacentHTML("beforeend", curvesOf(time, curves[k], k ? curves[0] : null, people));
      figure.querySelector("svg").setAttribute("aria-label", words);
      figure.append(node("figcaption", words));
      return figure;
    }));
    const row = (cells, tag) => { const line = document.createElement("tr"); line.append(...cells.map((cell) => node(tag, typeof cell === "number" ? cell.toFixed(2) : cell ?? "–"))); return line; };
    by("differences").replaceChildren(row(HEADS, "th"), ...differences.map((cells) => row(cells, "td")));
  }
}

// People out over time: a mean with its band, and that of the first design for comparison.
function curvesOf(time, { low, mean, high }, first, people) {
  const { width, height, left, right, top, bottom } = CHART, end = time[time.length - 1], parts = [];
  const x = (at) => (left + (width - left - right) * at / end).toFixed(1), y = (value) => (height - bottom - (height - top - bottom) * value / people).toFixed(1);
  const points = (values) => values.map((value, k) => `${x(time[k])},${y(value)}`);
  for (const tick of ticks(people, 4).filter((value) => value <= people)) parts.push(`<line class="grid" x1="${left}" x2="${width - right}" y1="${y(tick)}" y2="${y(tick)}"/><text x="${left - 5}" y="${Number(y(tick)) + 4}" text-anchor="end">${tick}</text>`);
  for (const tick of ticks(end, 5).filter((value) => value < 0.9 * end)) parts.push(`<text x="${x(tick)}" y="${height - 7}" text-anchor="middle">${tick}</text>`);
  parts.push(`<text x="${width - right}" y="${height - 7}" text-anchor="end">${end.toFixed(0)} s</text>`, `<polygon class="band" points="${[...points(high), ...points(low).reverse()].join(" ")}"/>`);
  if (first) parts.push(`<polyline class="curve first" points="${points(first.mean).join(" ")}"/>`);
  parts.push(`<polyline class="curve" points="${points(mean).join(" ")}"/>`);
  return `<svg viewBox="0 0 ${width} ${height}" role="img">${parts.join("")}</svg>`;
}

// The panel beside the picture: counts, legend, tables, and who is selected; what is told about the run.

const by = (id) => document.getElementById(id);
const seconds = (time) => `${time.toFixed(1)} s`;
const capital = (text) => text[0].toUpperCase() + text.slice(1);
const goTo = (time) => time === null ? "" : ` <button type="button" value="${time}">Show ${seconds(time)}</button>`;
const asTerms = (facts) => facts.map(([name, value]) => `<dt>${name}</dt><dd>${escaped(value)}</dd>`).join("");
const write = (node, text) => { if (node.told !== text) node.textContent = node.told = text; };  // So that what stays needs no layout.
const escaped = (text) => String(text).replace(/[&<>"]/g, (sign) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[sign]);

class Panel {
  constructor(record, series, layout, people) {
    Object.assign(this, { record, series, layout, people });
    this.exits = this.table("exits", series.exits, 2);
    this.lines = this.table("lines", record.lines, 3);
    by("line-section").hidden = !record.lines.length;
    this.stairs = this.table("stairs", series.stairs, 2);
    this.storeys = this.table("storeys", series.storeys, 1);
    by("stair-section").hidden = !series.stairs.length;
    by("storey-section").hidden = series.storeys.length < 2;
    this.groupNames = [...record.groups, "no group"].map((name, index) => ({ name, index, look: record.colours.groups[index] }))
      .filter(({ index }) => record.group.some((group) => group === (index < record.groups.length ? index : -1))).sort(byName);
    this.tellAbout();
  }

  table(id, rows, columns) {
    return rows.map(({ name }, index) => {
      const row = by(id).tBodies[0].insertRow();
      const swatch = rows.length > 1 ? `<svg class="key" viewBox="0 0 30 4"><line x2="30" y1="2" y2="2" style="${lineStyle(index)}"/></svg>` : "";
      row.insertCell().innerHTML = swatch + escaped(name);
      return Array.from({ length: columns }, () => row.insertCell());
    });
  }

  // Tells how many doubts there are, and gives warnings that name a time a button that leads to it.
  tellAbout() {
    for (const line of by("warnings").querySelectorAll("li")) line.insertAdjacentHTML("beforeend", goTo(timeIn(line.textContent)));
    const doubts = this.record.quality_warnings.length;
    by("doubts").hidden = !doubts;
    by("doubts").textContent = doubts;
    by("doubts").title = `${doubts} quality warning${doubts > 1 ? "s" : ""}`;
  }

  // The legend; a click on a group shows it alone.
  showLegend(quantity, service, highlighted, highlight) {
    if (quantity !== "group") {
      const scale = this.people.scaleOf(quantity, service);
      by("legend").innerHTML = bar(onFloor({ ...scale, isVeiled: false }, [0, 0, 0]), scale, scale.top, this.record.colours.nothing) + (AIR.includes(quantity) ? noteOf(aboutAir(quantity, this.record.smoke)) : "");
      return;
    }
    const list = document.createElement("ul");
    for (const { name, index, look: [body, head, belt] } of this.groupNames) {
      const button = document.createElement("button");
      button.type = "button";
      button.innerHTML = `<span class="swatch figure" style="background:linear-gradient(${head} 34%, ${body} 34% 56%, ${belt} 56% 76%, ${body} 76%)"></span>${escaped(name)}`;
      button.setAttribute("aria-pressed", highlighted === index);
      button.addEventListener("click", () => highlight(highlighted === index ? null : index));
      list.append(Object.assign(document.createElement("li")));
      list.lastChild.append(button);
    }
    by("legend").replaceChildren(list);
  }

  update(time, now) {
    const { series, record } = this;
    write(by("time"), seconds(time));
    write(by("inside"), series.inside.at(time));
    write(by("outside"), countUpTo(series.out, time));
    const state = record.stateAt(time);
    series.exits.forEach(({ times, index: exit }, index) => {
      if (state !== this.state) this.exits[index][0].parentElement.cells[0].dataset.note = record.noteOn(exit, state);
      write(this.exits[index][0], countUpTo(times, time));
      write(this.exits[index][1], flowAt(times, time, record.begin).toFixed(1));
    });
    record.lines.forEach(({ times, width }, index) => {
      const flow = flowAt(times, time, record.begin);
      write(this.lines[index][0], countUpTo(times, time));
      write(this.lines[index][1], flow.toFixed(1));
      write(this.lines[index][2], (flow / width).toFixed(2));
    });
    series.stairs.forEach(({ entered, inside }, index) => {
      write(this.stairs[index][0], countUpTo(entered, time));
      write(this.stairs[index][1], inside.at(time));
    });
    series.storeys.forEach(({ inside }, index) => write(this.storeys[index][0], inside.at(time)));
    this.state = state;
  }

  // Who somebody is, and where and how fast at the time shown.
  tellPerson(p, time, now) {
    by("person").hidden = p === null;
    if (p === null) return;
    const { record } = this, i = now.person.subarray(0, now.count).indexOf(p), isInside = i >= 0;
    const group = record.group[p] < 0 ? "no group" : record.groups[record.group[p]];
    const left = record.outTime[p] < Infinity, exit = record.building.exits[record.outBy[p]];
    const facts = [["Group", group]];
    if (isInside) {
      const row = now.row[i], force = record.motion.force[row];
      facts.push(["Level", record.building.levels[now.level[i]].name]);
      facts.push(["Speed", `${record.motion.speed[row].toFixed(2)} m/s`]);
      facts.push(["Contact force", force ? `${short(force)} N` : record.people_scales["contact force"].below]);
      if (record.motion.dose.length) facts.push(["Dose", record.motion.dose[row].toFixed(3)]);
      if (this.people.smoke) facts.push(["Smoke at the head", `${this.people.valueOf(AIR[0], now, i).toFixed(2)} 1/m`]);
      facts.push(["Waited so far", seconds(record.motion.waited[row])]);
    } else {
      facts.push(["Level", time < record.outTime[p] ? "not inside yet" : "out"]);
    }
    if (record.speed) facts.push(["Desired speed", `${(record.speed[p] / 100).toFixed(2)} m/s`]);
    const response = record.response_time?.[p];  // -1 of those who never start
    if (response !== undefined) facts.push(["Response time", response < 0 ? "never" : `${(response / 100).toFixed(2)} s`]);
    facts.push(["Body height", `${(record.height[p] / 1000).toFixed(2)} m`]);
    facts.push(["Body radius", `${(record.radius[p] / 10).toFixed(1)} cm`]);
    facts.push(["Exit time", left ? (record.hasTimes ? `${record.outTime[p].toFixed(2)} s` : `by ${seconds(record.outTime[p])}`) : "did not get out"]);
    if (left) facts.push(["Exit used", `${exit ? exit.name : "unknown"}${record.hasTimes ? "" : " (the nearest)"}`]);
    if (by("person-name").textContent !== `Person ${p}`) by("person-name").textContent = `Person ${p}`;
    by("person-facts").innerHTML = asTerms(facts);
  }
}

// Lines of exits, stairs and levels in charts: colours of the theme that colour-blind people tell apart, then dashes.
const LINES = 6, DASHES = ["none", "7 3", "2 3"];
const lineStyle = (index) => `stroke:var(--line-${1 + index % LINES});stroke-dasharray:${DASHES[Math.floor(index / LINES) % DASHES.length]}`;

const noteOf = (text) => `<div class="below">${text}</div>`;

// The bar of a scale with its colours, and numbers or levels of service below it.
function bar(stops, { unit, least, isLogarithmic, below, edges, letters }, top, nothing) {
  const bands = edges && [...letters].map((letter, k) => {
    const [from, to] = [k ? edges[k - 1] : 0, Math.min(top, edges[k] ?? top)];
    return `<span style="left:${100 * from / top}%" title="${k ? edges[k - 1] : 0} ${unit} or more">${to - from > 0.03 * top ? letter : ""}</span>`;
  });
  const numbers = isLogarithmic ? [least, Math.sqrt(least * top), top].map((value) => Number(value.toPrecision(2))) : [0, top / 2, top];
  return `<div class="bar" style="background:${gradient(stops)}"></div>` + (bands ? `<div class="bands">${bands.join("")}</div>`
    : `<div class="ends"><span>${short(numbers[0])}</span><span>${short(numbers[1])}</span><span>≥ ${short(numbers[2])} ${unit}</span></div>`)
    + (below ? `<div class="below"><span class="swatch" style="background:${nothing}"></span>${below}</div>` : "");
}

const short = (value) => value >= 1000 ? value.toLocaleString("en").replaceAll(",", "\u202f") : value;

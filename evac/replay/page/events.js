// What happened when: on the time line and as a list; a click goes there.

const JAM = 10;  // So many people who wait at once, on one level or stair, are a jam.
const SIGNS = { longest: "★", out: "▲", clear: "■", jam: "●", warning: "◆", case: "▼" };
const TOLD = /\b(?:t = |from )(\d+(?:\.\d+)?)(?= s\b| and | to )/;  // The first time in a text.

// When a text says that something was [s]; null if it does not.
const timeIn = (text) => TOLD.test(text) ? Number(TOLD.exec(text)[1]) : null;

// The events of a run in the order of time; of those that were at a place, its level and its point in plan [m].
function findEvents(record, series) {
  const events = record.changes.map(([time, text]) => ({ time, kind: "case", text }));
  for (const text of record.quality_warnings) if (timeIn(text) !== null) events.push({ time: timeIn(text), kind: "warning", text });
  if (record.longest) events.push({ kind: "longest", ...record.longest });
  const { out, order } = series;
  const leave = (p, text) => {
    const [x, y] = record.outAt.subarray(2 * p), exit = record.building.exits[record.outBy[p]];
    events.push({ time: record.outTime[p], kind: "out", text, at: exit && { level: exit.level, x, y } });
  };
  if (out.length) leave(order[0], "first person out");
  if (out.length > 1) leave(order.at(-1), out.length === record.people ? "last person out" : "last of those who got out");
  for (const { name, inside } of series.storeys.length > 1 ? series.storeys : []) {
    const { times, numbers } = inside;
    if (times.length && numbers.at(-1) === 0) events.push({ time: times.at(-1), kind: "clear", text: `${name}: clear` });
  }
  return [...events, ...findJams(record, series)].sort((a, b) => a.time - b.time);
}

// The first time at which a jam is on each stair, and on the floors of each storey.
function findJams({ motion, frames, building, people }, { storeys, placeOf }) {
  const { first, person, level, x, y, waited, times } = motion, events = [];
  const names = [...storeys, ...building.stairs].map(({ name }) => name), isTold = names.map(() => false), last = new Float32Array(people);
  for (let k = 0; k < frames; k++) {
    const waiting = names.map(() => []);
    for (let row = first[k]; row < first[k + 1]; row++) {
      if (waited[row] > last[person[row]]) waiting[placeOf[level[row]]].push(row);
      last[person[row]] = waited[row];
    }
    waiting.forEach((rows, place) => {
      if (rows.length < JAM || isTold[place]) return;
      isTold[place] = true;
      const one = rows[rows.length >> 1];
      events.push({ time: times[k], kind: "jam", text: `${names[place]}: jam, ${rows.length} wait`, at: { level: level[one], x: x[one], y: y[one] } });
    });
  }
  return events;
}

// A bar for each compartment up to its available time, with a mark when the last one left it; the worst ones.
function drawBars(rows, { begin, end }) {
  const at = (time) => `${100 * Math.min(Math.max((time - begin) / (end - begin || 1), 0), 1)}%`;
  by("bars").innerHTML = rows.map(({ name, status, text, limit, required }) => `<div class="${status}" role="img" aria-label="${escaped(text)}" title="${escaped(text)}">
    <i style="width: ${at(limit)}"></i>${required === null ? "" : `<b style="left: ${at(required)}"></b>`}<span>${escaped(name)}</span></div>`).join("");
}

// The people with the least margins; a click selects one of them and goes to the time.
function listMargins(rows, go) {
  by("margin-section").hidden = !rows.length;
  for (const { person, time, text } of rows) {
    const item = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.innerHTML = `<span></span><span>${time.toFixed(2)} s</span><span>${escaped(text)}</span>`;
    button.addEventListener("click", () => go(person, time));
    item.append(button);
    by("margins").append(item);
  }
}

class TimeLine {
  constructor(events, { begin, end }, seek) {
    this.events = events;
    this.rows = events.map(({ time, kind, text }) => {
      const mark = document.createElement("button"), row = document.createElement("button"), item = document.createElement("li");
      for (const button of [mark, row]) button.addEventListener("click", () => seek(time));
      Object.assign(mark, { type: "button", className: kind, title: `${time.toFixed(2)} s: ${text}`, textContent: SIGNS[kind], tabIndex: -1, ariaHidden: "true" });
      mark.style.left = `${100 * (time - begin) / (end - begin || 1)}%`;
      Object.assign(row, { type: "button" });
      row.innerHTML = `<span class="${kind}">${SIGNS[kind]}</span><span>${time.toFixed(2)} s</span><span>${escaped(text)}</span>`;
      item.append(row);
      by("marks").append(mark);
      by("events").append(item);
      return item;
    });
    by("event-section").hidden = !events.length;
  }

  // Marks the last event up to a time.
  update(time) {
    const last = this.events.filter((event) => event.time <= time + 1e-9).length - 1;
    if (last === this.last) return;
    this.last = last;
    this.rows.forEach((row, index) => { row.ariaCurrent = index === last ? "true" : "false"; });
  }

  // The event at a time that was at a place; the longest queue rather than others.
  placed(time) {
    const all = this.events.filter((event) => event.at && Math.abs(event.time - time) < 1e-6);
    return all.find(({ kind }) => kind === "longest") ?? all[0];
  }

  // Time of the next event after or before a time.
  next(time, by) {
    const times = this.events.map((event) => event.time);
    return by > 0 ? times.find((one) => one > time + 1e-6) : times.findLast((one) => one < time - 1e-6);
  }
}

// What is selected, with its values; the storeys; the findings; the changes of the file.

// Of each section, its keys: label, and how they are given.
const NUMBER = "number", TEXT = "text", STOREY = "storey";
const OTHER_USE = "another use …";
const BENT = ["", "left", "right"];
const FIELDS = {
  rooms: { people: ["People", NUMBER], density: ["People per m²", NUMBER] },
  storeys: { z: ["Height [m]", NUMBER], wall: ["Walls [m]", NUMBER], like: ["Like storey", STOREY] },
  shafts: { lower: ["From storey", STOREY], upper: ["To storey", STOREY], width: ["Width [m]", NUMBER], rise: ["Rise [m]", NUMBER], going: ["Going [m]", NUMBER], length: ["Length [m]", NUMBER], turn: ["Turn", BENT], gap: ["Gap [m]", NUMBER], landing: ["Landing [m]", NUMBER], landings: ["Landings", NUMBER] },
  stairs: { lower: ["From storey", STOREY], upper: ["To storey", STOREY], length: ["Length [m]", NUMBER], turn: ["Turn", BENT], gap: ["Gap [m]", NUMBER], landing: ["Landing [m]", NUMBER], landings: ["Landings", NUMBER] },
  flights: { stair: ["Stair", TEXT], lower_z: ["From height [m]", NUMBER], upper_z: ["To height [m]", NUMBER] },
  landings: { stair: ["Stair", TEXT], z: ["Height [m]", NUMBER] },
  doors: { outside: ["If it leads outside", ["", "refuse", "exit", "opening"]] },
  areas: {}, obstacles: {}, lifts: {}, exits: {}, openings: {},
};
const node = (tag, text = "", values = {}) => Object.assign(document.createElement(tag), { textContent: text }, values);

// Gives a box other content; what is at the place of what had the focus has it then.
function refill(box, content) {
  const all = () => [...box.querySelectorAll("button, input, select")], at = all().indexOf(document.activeElement);
  box.replaceChildren(...content);
  if (at >= 0) all()[at]?.focus();
}

class Inspector {
  constructor(store, view, act, forms, loads) { Object.assign(this, { store, view, act, forms, loads }); }

  get table() { return this.store.now; }

  field(label, value, kind, change) {
    const box = node("label", label), isChoice = Array.isArray(kind) || kind === STOREY;
    const input = isChoice ? document.createElement("select") : node("input", "", { type: kind, step: "any", value: value ?? "", placeholder: value === null ? "inf" : "" });  // JSON has null for it.
    if (isChoice) {
      const all = kind === STOREY ? ["", ...this.table.storeys.map(({ name }) => name)] : kind;
      input.append(...all.map((one) => node("option", one || "–", { value: one })));
      input.value = value ?? "";
    }
    input.addEventListener("change", () => {
      const given = kind === NUMBER ? input.valueAsNumber : input.value.trim();
      change(given === "" || Number.isNaN(given) ? undefined : given);
    });
    box.append(input);
    return box;
  }

  show(selected) {
    const box = by("inspector"), storey = this.table.storey(this.view.storey);
    const index = this.table.rows("storeys").indexOf(storey), ref = selected ?? { section: "storeys", index }, row = this.table.row(ref);
    if (!row) return box.replaceChildren(node("h2", "Nothing is selected"));
    if (!selected && document.body.classList.contains("fixed")) return box.replaceChildren(node("h2", `Storey ${row.name}`), node("p", "This building is no plan: it is shown, and cannot be drawn on here"));
    const { section } = ref, isGround = ref.part !== undefined, what = selected ? singular(section) : "storey", commit = (next) => this.store.commit(next), more = this.view.also.length;
    const set = (key) => (value) => this.put(ref, key, value), isOfCase = [...CASE, "case"].includes(section), isNamed = !isGround && !["behaviours", "case", ...PIECES].includes(section), parts = [node("h2", heading(what, row.name ?? row.stair ?? (isNamed ? "" : ref.index ?? "")) + (more ? ` and ${more} more` : ""))];
    if (isNamed && !more) parts.push(this.field("Name", row.name, TEXT, (name) => { if (name && name !== row.name) { if (what === "storey") this.act.renamed(name); commit(this.table.rename(ref, name)); } }));
    if (isOfCase) parts.push(...this.forms.fieldsOf(ref, row));
    if (section === "rooms") parts.push(...this.use(ref, row));
    if (!isOfCase && !isGround) for (const [key, [label, kind]] of Object.entries(FIELDS[section])) if (key !== "outside" || !row.segment?.rooms?.[1]) parts.push(this.field(label, row[key], kind, set(key)));
    if (STAIRS.includes(section) && this.table.content.case && !more) parts.push(...this.moving(row));
    if (section === "lifts" && !more) parts.push(this.stops(ref, row), ...this.forms.operation(ref, row));
    if (what !== "storey" && !isOfCase && !more) parts.push(...this.sizes(ref, row));
    const actions = node("div", "", { className: "actions" });
    if (selected && !isGround && !more && !["behaviours", "case"].includes(section)) actions.append(this.button("Duplicate", "Ctrl+D", this.act.duplicate));
    if (section === "openings") actions.append(this.button("Make it an exit", "", () => { commit(this.table.remove(ref).add("exits", row)); this.act.select({ section: "exits", index: this.table.rows("exits").length - 1 }); }));
    if (selected || this.table.storeys.length > 1) actions.append(this.button("Delete", "Delete", this.act.remove));
    refill(box, [...parts, actions]);
  }

  // Gives a key of all that is selected a value.
  put(ref, key, value) { this.store.commit([ref, ...this.view.also].reduce((table, one) => table.put(one, key, value), this.table)); }

  // The use of a room: from the table of loads, or another one, which groups of the case name.
  use(ref, row) {
    const { loads } = this, load = loads[row.use], set = (use) => this.put(ref, "use", use);
    const held = ({ ground }) => ground ? `${ground} m² a person` : "nobody", all = [...new Set([...Object.keys(loads), ...this.table.rows("rooms").map(({ use }) => use)])].filter(Boolean);
    const box = this.field("Use", row.use, ["", ...all, OTHER_USE], (use) => {
      if (use !== OTHER_USE) return set(use);
      const other = this.field("Use", "", TEXT, set);
      box.replaceWith(other);
      other.querySelector("input").focus();
    });
    for (const option of box.querySelectorAll("option")) if (loads[option.value]) option.textContent += `: ${held(loads[option.value])}`;
    return row.use ? [box, node("p", load ? `${capital(held(load))} (${load.source})${row.people === undefined && row.density === undefined ? "" : ", unless stated below"}` : "No load is known: state the people below, or in a group")] : [box];
  }

  // How the ground of a stair moves, which is then an escalator.
  moving({ name }) {
    const now = this.table.movingOf(name), commit = (moving) => this.store.commit(this.table.move(name, moving));
    const speed = this.field("Moves at [m/s]", now?.speed, NUMBER, (value) => commit(value === undefined ? undefined : { ...MOVING, ...now, speed: value }));
    return now ? [speed, this.field("Towards", now.towards ?? "up", [...new Set(["up", "down", now.towards ?? "up"])], (towards) => commit({ ...now, towards }))] : [speed];
  }

  // The storeys at which a lift stops, the highest first.
  stops(ref, { storeys }) {
    const box = document.createElement("fieldset"), all = this.table.storeys.map(({ name }) => name);
    box.append(node("legend", "Stops"), ...all.toReversed().map((name) => {
      const label = node("label", name), input = node("input", "", { type: "checkbox", checked: storeys.includes(name) });
      input.addEventListener("change", () => this.store.commit(this.table.put(ref, "storeys", all.filter((one) => one === name ? input.checked : storeys.includes(one)))));
      label.append(input);
      return label;
    }));
    return box;
  }

  button(text, title, action) {
    const button = node("button", text, { type: "button", title });
    button.addEventListener("click", action);
    return button;
  }

  // Widths of doors, widths and depths of outlines, and the length of a selected wall, which can be typed.
  sizes(ref, row) {
    const line = ON_WALLS.includes(ref.section) && this.view.lineOf(ref, row), lines = line ? this.view.linesOf(ref, row) : [], found = [];
    const commit = (next) => this.store.commit(next);
    if (isTie(row.segment)) {
      for (const [key, label] of [["width", "Width [m]"], ["at", "Middle at [m]"]]) found.push(this.field(label, row.segment[key], NUMBER, (value) => { const { [key]: _, ...rest } = row.segment; commit(this.table.put(ref, "segment", value === undefined ? rest : { ...rest, [key]: value })); }));
      const [start] = this.table.wallOf(row.segment, row.storey) ?? [];
      found.push(node("p", `On the wall of ${row.segment.rooms.join(" and ")}${start ? `, from its end at ${start.map(mm).join(", ")}` : ""}`));
    } else if (line && lines.length > 1) {
      found.push(node("p", `${wide(lines).toFixed(2)} m wide, in ${lines.length} parts`));
    } else if (line) {
      const [a, b] = line, whole = length(minus(b, a)), at = middle(line);
      found.push(this.field("Width [m]", mm(whole), NUMBER, (width) => { if (width > 0) commit(this.table.set(ref, moved(row, (end) => at.map((value, i) => mm(value + (end[i] - value) * width / whole))))); }));
    }
    const { selected } = this.view, rings = this.table.rings(ref);
    const [door] = doorsOf(row);
    if (door) found.push(this.field("Door [m]", mm(length(minus(...door))), NUMBER, (width) => { if (width > 0) commit(this.table.put(ref, "door", onWall(middle(door), this.table.outlines(ref).flatMap(sidesOf2), width))); }));
    if ([...POLYGONS, "lifts", "storeys"].includes(ref.section) && rings.length) {
      const spans = [0, 1].map((i) => range(rings.flat(), (corner) => corner[i]));
      for (const [i, label] of [[0, "Width [m]"], [1, "Depth [m]"]]) {
        const [low, high] = spans[i];
        found.push(this.field(label, mm(high - low), NUMBER, (size) => {
          if (!(size > 0)) return;
          const stretch = (corner) => corner.map((value, k) => k === i ? mm(low + (value - low) * size / (high - low)) : value);
          commit(this.table.set(ref, moved(row, stretch, (number) => ref.part === undefined || number === ref.part)));
        }));
      }
      found.push(node("p", `${Math.abs(rings.reduce((sum, ring, k) => sum + (k ? -1 : 1) * Math.abs(areaOf(ring)), 0)).toFixed(1)} m²`));
    }
    if (selected?.side) found.push(this.field("This wall [m]", mm(length(minus(selected.side[1], selected.side[0]))), NUMBER, (size) => this.stretch(rings, selected.side, size)));
    return found;
  }

  // Gives a wall a length: the wall at its end is moved along it.
  stretch(rings, [a, b], size) {
    if (!(size > 0)) return;
    const { step, whole } = nearest(a, [a, b]), by = step.map((value) => value * (size - whole));
    const next = rings.flatMap(sidesOf2).find(([start]) => keyOf(start) === keyOf(b));
    this.act.select(null);
    if (next) this.store.commit(this.table.moveWall(this.view.storey, next, across(next, by)));
  }

  // What the tool does, or why it cannot now, and what to do then.
  showHint(fault, hint) {
    by("hint").replaceChildren(fault || hint);
    if (fault) by("hint").append(" ", this.button("Copy this storey up", "", () => { this.act.copyUp(1); this.view.canvas.focus(); }));
  }

  showStoreys() {
    refill(by("storeys"), this.table.storeys.map(({ name, z, like }) => {
      const button = this.button(name, "Page up, Page down", () => this.act.goTo(name)), item = document.createElement("li");
      button.append(node("small", `${(z ?? 0).toFixed(2)} m${like ? `, like ${like}` : ""}`));
      button.setAttribute("aria-pressed", name === this.view.storey);
      item.append(button);
      return item;
    }));
  }

  showFindings(findings) {
    const told = findings.filter(({ number }) => number);
    by("count").textContent = told.length || "none";
    refill(by("findings"), told.map((one) => {
      const item = document.createElement("li"), more = one.others.length ? ` (and ${one.others.length} more like this)` : "", where = one.storey ?? one.level;
      const button = this.button(`${one.number} ${one.kind}: ${one.text}${more}`, "", () => this.act.goToFinding(one));
      button.className = one.kind;
      if (where) button.append(node("span", where));
      const { tool } = one;
      if (tool) button.append(node("span", `draw one with the tool ${capital(tool)} (${TOOLS[tool].key.toUpperCase()}): a click here takes it`));
      else if (one.remedy) button.append(node("span", `remedy: ${one.remedy.replaceAll("\n", ", ")}`));
      item.append(button);
      return item;
    }));
  }

  showChanges(difference, title) {
    by("changes-title").textContent = title;
    by("changes").replaceChildren(...difference.split("\n").filter((line) => !line.startsWith("--- ")).map((line) => line.startsWith("+++ ") ? node("strong", line.slice(4)) : node("div", line, { className: { "+": "added", "-": "removed" }[line[0]] ?? "" })));
    if (!difference) by("changes").textContent = "none";
  }
}

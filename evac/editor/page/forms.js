// What the case says beside its building: groups, events, phases, behaviours and limits, with forms made from its schema.

const LISTS = ["people", "event", "phase", "compartment"];
const TABLES = ["safety", "simulation"];
const SHOWN = {  // Fields that are there from the start; the others are added.
  people: ["preset", "number", "density", "level", "area", "use", "speed"], event: ["time", "kind", "target", "value"], phase: ["of", "delay", "cue"], compartment: ["of", "available", "visibility", "fed"], simulation: ["duration", "seed"], lifts: ["capacity", "speed"],
};
const BY_MEAN = "lognormal by mean", FACTOR = "factor";
const NUMBERS = { constant: "value", [BY_MEAN]: "mean, standard deviation", [FACTOR]: "of the speed on the flat" };  // What the numbers are.

class Forms {
  constructor(store, act, { schema, presets }) {
    Object.assign(this, { store, act, schema, presets, added: new Set() });
    const [, table] = schema.definitions.Distribution.anyOf;
    this.kinds = Object.entries(table.properties).filter(([name]) => !["minimum", "maximum"].includes(name));
    for (const section of LISTS) by(`add-${section}`).addEventListener("click", () => this.add(section));
    by("of-case").hidden = !this.table.content.case;
  }

  get table() { return this.store.now; }

  add(section) {
    const storey = this.act.storey(), name = this.table.unique(section, section);
    const row = { people: { name, level: storey, number: 10 }, event: { name, time: 0, kind: "close", target: this.table.rows("exits")[0]?.name ?? "" }, phase: { name, of: [storey], delay: 60 }, compartment: { name, of: [storey], available: 120 } }[section];
    this.store.commit(this.table.add(section, row));
    this.act.select({ section, index: this.table.rows(section).length - 1 });
  }

  // The lists at the left.
  showRail(selected) {
    if (!this.table.content.case) return;
    for (const section of LISTS) {
      refill(by(section), this.table.rows(section).map((row, index) => {
        const item = document.createElement("li"), button = this.button(row.name, () => this.act.select({ section, index })), where = row.area ?? row.use ?? row.level ?? "";
        if (LISTS.indexOf(section) < 2) button.append(node("small", section === "people" ? `${row.number ?? (row.density ? `${row.density} per m²` : row.positions?.length ?? "as planned")}${where && `, ${where}`}` : `${row.kind}${row.time === undefined ? "" : `, ${row.time} s`}`));
        button.setAttribute("aria-pressed", selected?.section === section && selected.index === index);
        item.append(button);
        return item;
      }));
    }
    this.showSwitches("behaviours", this.schema.properties.behaviours.properties, "behaviours");
    this.showSwitches("tables", Object.fromEntries(TABLES.map((name) => [name, this.schema.properties[name]])), "case");
  }

  // Tables that are there or not, such as behaviours.
  showSwitches(id, schemas, section) {
    const own = this.table.rows(section), selected = this.act.selected();
    refill(by(id), Object.entries(schemas).map(([name, schema]) => {
      const item = document.createElement("li"), words = name.replaceAll("_", " "), ref = { section, index: name }, isOn = own[name] !== undefined && own[name] !== false;
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: isOn });
      box.setAttribute("aria-label", words);
      box.addEventListener("change", () => { this.store.commit(box.checked ? this.table.set(ref, {}) : this.table.remove(ref)); this.act.select(box.checked ? ref : null); });
      const button = this.button(words, () => this.act.select(ref), this.resolved(schema).description);
      button.disabled = !isOn;
      button.setAttribute("aria-pressed", selected?.section === section && selected.index === name);
      item.append(box, button);
      return item;
    }));
  }

  button(text, action, title = "") {
    const button = node("button", text, { type: "button", title });
    button.addEventListener("click", action);
    return button;
  }

  // The schema itself: behind references, without null and, of behaviours, without true and false.
  resolved(schema) {
    const { $ref, anyOf, ...rest } = schema;
    if ($ref?.endsWith("/Distribution")) return { ...rest, isDistribution: true };
    if ($ref) return { ...this.resolved(this.schema.definitions[$ref.split("/").pop()]), ...rest };
    const options = (anyOf ?? []).filter(({ type }) => type !== "null"), table = options.find(({ type }) => type === "object");
    if (options.some((one) => one.$ref?.endsWith("/Distribution"))) return { ...rest, isDistribution: true, hasFactor: options.length > 1 };
    if (options.length === 1 || table) return { ...this.resolved(table ?? options[0]), ...rest };
    return schema;
  }

  fieldsOf(ref, row) {
    const { section, index } = ref, all = this.schema.properties, isList = LISTS.includes(section), schema = this.resolved(isList ? all[section].items : section === "case" ? all[index] : all.behaviours.properties[index]);
    const change = (next) => this.store.commit(this.table.set(ref, next)), about = isList ? [] : [node("p", schema.description)];
    return [...about, ...this.fields(schema, row === true ? {} : row, change, SHOWN[index === "simulation" ? index : section] ?? Object.keys(schema.properties), `${section}.${index}`)];
  }

  // How a lift works.
  operation(ref, { operation = {} }) {
    const change = (next) => this.store.commit(this.table.put(ref, "operation", Object.keys(next).length ? next : undefined));
    return this.fields(this.resolved({ $ref: "LiftOptions" }), operation, change, SHOWN.lifts, `lifts.${ref.index}`);
  }

  // A field for each key that is there or shown anyway, and a choice of the others.
  fields(schema, values, change, shown, place) {
    const rank = (key) => shown.indexOf(key) < 0 ? shown.length : shown.indexOf(key), all = Object.entries(schema.properties ?? {}).filter(([key]) => key !== "name").sort(([a], [b]) => rank(a) - rank(b)), isHere = ([key]) => shown.includes(key) || values[key] !== undefined || this.added.has(`${place}.${key}`);
    const set = (key) => (value) => { const { [key]: _, ...rest } = values; change(value === undefined ? rest : { ...values, [key]: value }); };
    const parts = all.filter(isHere).map(([key, one]) => this.field(key, this.resolved(one), values[key], set(key), `${place}.${key}`));
    const others = all.filter((one) => !isHere(one)).map(([key]) => key);
    if (others.length) {
      const more = this.choice("More", ["", ...others], "", (key) => { this.added.add(`${place}.${key}`); this.act.select(this.act.selected()); });
      parts.push(more);
    }
    return parts;
  }

  labelled(text, input, title = "") {
    const label = node("label", text, { title });
    label.append(input);
    return label;
  }

  choice(text, options, value, change, title) {
    const select = document.createElement("select");
    select.append(...options.map((one) => node("option", one || "–", { value: one })));
    select.value = value ?? "";
    select.addEventListener("change", () => change(select.value || undefined));
    return this.labelled(text, select, title);
  }

  input(text, values, change, title) {
    const input = Object.assign(document.createElement("input"), { step: "any", ...values });
    input.addEventListener("change", () => change(input.type === "number" ? (Number.isNaN(input.valueAsNumber) ? undefined : input.valueAsNumber) : input.value.trim() || undefined));
    return this.labelled(text, input, title);
  }

  // Names that a key can have.
  names(place) {
    const of = (...sections) => sections.flatMap((section) => this.table.rows(section).map(({ name }) => name)), key = place.split(".").pop();
    const found = { level: of("storeys"), area: of("areas", "rooms"), use: [...new Set(this.table.rows("rooms").map(({ use }) => use))], preset: [...Object.keys(this.table.content.case?.presets ?? {}), ...Object.keys(this.presets)], target: of("exits", "doors", "shafts", "stairs", "lifts", "areas"), discharge: of("storeys"), start: of("storeys") };
    return found[key]?.filter(Boolean);
  }

  field(key, schema, value, change, place) {
    const { type, description: title = "" } = schema, [unit = ""] = title.match(/ \[[^\]]+\]$/) ?? [], text = capital(key.replaceAll("_", " ")) + unit, hint = value === null ? "inf" : schema.default === undefined ? "" : String(schema.default), names = this.names(place);
    if (schema.isDistribution) return this.distribution(text, schema, value, change);
    if (names) return this.choice(text, [...new Set(["", ...names, ...(value === undefined ? [] : [value])])], value, change, title);
    if (schema.enum) return this.choice(text, ["", ...schema.enum], value, change, title);
    if (type === "boolean") return this.choice(text, ["", "yes", "no"], { true: "yes", false: "no" }[value], (word) => change(word && word === "yes"), title);
    if (type === "number" || type === "integer") return this.input(text, { type: "number", value: value ?? "", placeholder: hint }, change, title);
    if (type === "object" && schema.properties) {
      const box = document.createElement("fieldset");
      box.append(node("legend", text, { title }), ...this.fields(schema, value ?? {}, (next) => change(Object.keys(next).length ? next : undefined), [], place));
      return box;
    }
    if (type === "array" && schema.items?.type === "string") return this.input(text, { value: (value ?? []).join(", "), placeholder: hint }, (words) => change(words?.split(",").map((word) => word.trim())), title);
    if (type === "string" && (value === undefined || typeof value === "string")) return this.input(text, { value: value ?? "", placeholder: hint }, change, title);
    return this.input(text, { value: value === undefined ? "" : JSON.stringify(value), placeholder: "JSON" }, (words) => change(parsed(words)), title);
  }

  // A number, or a distribution with its numbers and bounds, and its curve.
  distribution(text, { hasFactor, description = "" }, value, change) {
    const kinds = ["", "constant", ...this.kinds.map(([name]) => name).filter((name) => name !== "constant"), BY_MEAN, ...(hasFactor ? [FACTOR] : [])], { kind, numbers, ...bounds } = readDistribution(value);
    const [box, curve] = [document.createElement("fieldset"), node("canvas", "", { className: "curve" })];
    const meaning = NUMBERS[kind] ?? this.kinds.find(([name]) => name === kind)?.[1].description ?? "";
    box.append(node("legend", text, { title: description }), this.choice("Kind", kinds, kind, (next) => change(writeDistribution(next, next === kind ? numbers : [], bounds, value))));
    if (kind) box.append(this.input(capital(meaning), { value: numbers.map((one) => one ?? "inf").join(", ") }, (words) => change(writeDistribution(kind, (words ?? "").split(",").map(Number), bounds, value))));
    if (kind && ![FACTOR, "constant", "list"].includes(kind)) {
      for (const key of ["minimum", "maximum"]) box.append(this.input(capital(key), { type: "number", value: bounds[key] ?? "", placeholder: bounds[key] === null ? "inf" : "" }, (bound) => change(writeDistribution(kind, numbers, { ...bounds, [key]: bound }, value))));
      box.append(curve);
      this.draw(curve, value);
    }
    return box;
  }

  // The share of people who have at most a value, as Python computes it.
  async draw(canvas, value) {
    const { values, mean } = await ask("curve", { value }).catch(() => ({}));
    if (!values || !canvas.isConnected) return;
    const [w, h] = [canvas.width, canvas.height] = [canvas.clientWidth * devicePixelRatio, canvas.clientHeight * devicePixelRatio], pen = canvas.getContext("2d"), { accent, soft, line } = coloursOf("accent", "soft", "line");
    const low = Math.min(0, values[0]), high = values[values.length - 1] || 1, x = (at) => (at - low) / (high - low || 1) * (w - 2) + 1, foot = h - 14 * devicePixelRatio;
    Object.assign(pen, { strokeStyle: line, fillStyle: soft, font: `${11 * devicePixelRatio}px system-ui, "DejaVu Sans", sans-serif` });
    pen.strokeRect(0.5, 0.5, w - 1, foot);
    const words = `98 % from ${mm(values[0])} to ${mm(high)}, mean ${mm(mean)}`;
    pen.fillText(words, 2, h - 3 * devicePixelRatio);
    pen.beginPath();
    values.forEach((at, k) => pen.lineTo(x(at), foot - (k + 1) / (values.length + 1) * (foot - 2)));
    Object.assign(pen, { strokeStyle: accent, lineWidth: 2 * devicePixelRatio });
    pen.stroke();
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Share of people by value: ${words}`);
  }
}

function parsed(words) {
  try { return words === undefined ? undefined : JSON.parse(words); } catch { return words; }
}

// A distribution as it is in a case: a number, or a table with a kind and bounds.
function readDistribution(value) {
  if (value === undefined) return { kind: "", numbers: [] };
  if (value === null) return { kind: "constant", numbers: [null] };  // JSON has null for infinity.
  if (typeof value === "number") return { kind: "constant", numbers: [value] };
  const { minimum, maximum, ...rest } = value, [kind] = Object.keys(rest), given = rest[kind];
  if (given?.mean !== undefined) return { kind: BY_MEAN, numbers: [given.mean, given.deviation], minimum, maximum };
  return { kind, numbers: [given].flat(), minimum, maximum };
}

// The value with a kind, numbers and bounds; with numbers of a kind chosen just now, those that suit the value before.
function writeDistribution(kind, numbers, bounds, before) {
  if (!kind) return undefined;
  const [middle = 1] = readDistribution(before).numbers.filter((one) => typeof one === "number"), spread = Math.abs(middle) / 4 || 1;
  const first = { constant: [middle], [FACTOR]: [0.6], uniform: [middle - spread, middle + spread], normal: [middle, spread], [BY_MEAN]: [middle || 1, spread], lognormal: [Math.log(Math.max(0.1, middle)), 0.3], weibull: [2, middle || 1], gamma: [4, spread], list: [middle] }[kind];
  const given = numbers.length && numbers.every(Number.isFinite) ? numbers : first, limits = Object.fromEntries(Object.entries(bounds).filter(([, bound]) => bound !== undefined));
  if (kind === "constant") return given[0];
  if (kind === FACTOR) return { factor: given[0] };
  return { [kind === BY_MEAN ? "lognormal" : kind]: kind === BY_MEAN ? { mean: given[0], deviation: given[1] } : given, ...limits };
}

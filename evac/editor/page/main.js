// Puts everything together, and speaks with the server.

const PAGE = Array.from(crypto.getRandomValues(new Uint32Array(2)), (word) => word.toString(36)).join("");  // Of several that are open.
const UNDRAWN = ["select", "measure"];  // Tools that change no building.
const OF_CASE = ["escalator"];  // Tools that change the case, too.
const AT_ONCE = 0.15;  // What is judged faster is judged while something is dragged, too [s].
const KEYS = [
  ["V, R, W, D, E, S, K, U, L, G, A, O, M, P", "tools: select, room, wall, door, exit, stair, escalator, lift, flight, landing, area, obstacle, measure, picture"],
  ["Click, Enter", "with a tool: the next point; at the first one again, the outline ends"],
  ["Arrows, with Shift 1 m", "move what is selected, or the cross with which one draws, by 0.1 m"],
  ["Digits", "while drawing: a length, or 6x4 a rectangle, then Enter"],
  ["Shift while drawing", "no snapping"],
  ["N, Shift+N", "select the next thing of the storey, the one before"],
  ["C", "next wall or corner of what is selected, which arrows then move"],
  ["I", "type the values of what is selected"],
  ["Shift+click, B, Ctrl+A", "select several: this one, too; the next of the kind, too; all of the kind. Values and Delete are then for all"],
  ["Delete, Ctrl+D", "delete, duplicate"],
  ["Ctrl+Z, Ctrl+Shift+Z", "undo, redo"],
  ["Page up, Page down", "next storey up, down"],
  ["Arrows on the timeline", "move an event or a phase by 1 s, with Shift by 10 s"],
  ["3, F, + −", "plan or 3D, show all, zoom"],
  ["Ctrl+S, Ctrl+Shift+S", "save, save as"],
  ["Ctrl+Enter", "save and run, or stop the run"],
  ["T, ?", "light or dark, these keys"],
  ["Escape", "stop drawing, deselect"],
  ["Wheel; right or Alt drag", "zoom; move the view"],
];

async function ask(name, body) {
  let answer;
  try {
    answer = await fetch(name, body && { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  } catch {
    throw new Error("evac edit has ended. What is not saved is kept beside the file: start it again with the same file");
  }
  const data = await answer.json();
  if (!answer.ok) throw Object.assign(new Error(data.error), { status: answer.status });
  return data;
}

async function start() {
  const opened = await ask("document");
  if (opened.begin) return begin();
  const isCase = Boolean(opened.table.case), declared = await ask("forms");
  const store = new Store(opened.table, changed), view = new PlanView(by("view"), store), view3d = new View3D(by("view3d"));
  let { digest } = opened, onDisk = digest, isSent = false, isAsked = false, isStale = false, isSaving = false, isLost = false, lasted = 0;
  view.storey = store.now.storeys[0]?.name ?? "";
  document.body.classList.toggle("fixed", !opened.is_drawn);  // A building that is no plan is shown, not drawn.

  const act = {
    selected: () => view.selected,
    storey: () => view.storey,
    say(text) { by("told").textContent = text; },

    // Selects something, and others of its kind.
    select(ref, also = []) {
      if (ref) document.querySelector("aside").scrollTop = 0;
      Object.assign(view, { selected: ref, also });
      inspector.show(ref);
      forms.showRail(ref);
      timeline?.show(ref);
      view.draw();
    },

    // Takes something to what is selected, or out of it.
    toggle({ section, index }) {
      const all = [view.selected, ...view.also].map((one) => one.index), [first, ...also] = (all.includes(index) ? all.filter((one) => one !== index) : [index, ...all]).map((one) => ({ section, index: one }));
      act.select(first ?? null, also);
    },

    // What is on the storey of the kind that is selected, or its rooms.
    alike() {
      const { section } = view.selected ?? { section: "rooms" };
      return store.now.on(view.storey).filter((one) => one.section === section && one.part === undefined);
    },

    selectAlike() {
      const [first, ...also] = act.alike();
      if (first) act.select(first, also);
    },

    // Takes the next one of the kind to what is selected.
    addNext() {
      const all = act.alike(), at = all.findIndex((one) => one.index === view.selected?.index), next = [...all.slice(at + 1), ...all.slice(0, at + 1)].find((one) => !view.isSelected(one));
      if (view.selected && next) act.toggle(next);
      else if (next) act.select(next);
    },

    goTo(name) {
      view.storey = name;
      act.select(null);
      inspector.showStoreys();
      pictures.show();
    },

    renamed(name) {
      pictures.rename(view.storey, name);
      view.storey = name;
    },

    choose(tool) { tools.choose(tool); },

    // Storeys like the one that is shown, above all others.
    copyUp(count) {
      const before = store.now.storeys.length;
      store.commit(store.now.copyUp(view.storey, count));
      const added = store.now.storeys.slice(before).map(({ name }) => name);
      act.say(`${capital(added.length > 1 ? `${added[0]} to ${added.at(-1)}` : added[0])} added above, like ${view.storey}`);
      act.toolChanged();
    },

    measured(points) { tools.measured = points; },

    climb(by) {
      const all = store.now.storeys, next = all[all.findIndex(({ name }) => name === view.storey) + by];
      if (next) act.goTo(next.name);
    },

    goToFinding({ storey, at, ref, tool }) {
      if (storey && store.now.storey(storey)) act.goTo(storey);
      if (ref) act.select(ref);
      showView(false);
      if (at) view.reveal(at);
      if (tool && opened.is_drawn) tools.choose(tool);
      view.canvas.focus();
    },

    toolChanged() {
      for (const button of by("tools").children) button.setAttribute("aria-pressed", button.value === tools.tool);
      inspector.showHint(tools.fault(), TOOLS[tools.tool].hint);
      by("view").classList.toggle("drawing", tools.tool !== "select");
      showView(false);
    },

    remove() {
      const ref = view.selected ?? { section: "storeys", index: store.now.rows("storeys").findIndex(({ name }) => name === view.storey) };
      if (store.now.row(ref) && (opened.is_drawn || ref.section !== "storeys")) {
        const { corner, side, door, ...whole } = ref, all = [whole, ...view.also].sort((a, b) => b.index - a.index);
        Object.assign(view, { selected: null, also: [] });
        store.commit(all.reduce((table, one) => table.remove(one), store.now));
      }
    },

    duplicate() {
      const ref = view.selected;
      if (!ref || ref.part !== undefined || view.also.length) return;
      view.selected = { section: ref.section, index: store.now.rows(ref.section).length };
      store.commit(store.now.duplicate(ref));
    },

    // Selects the next or the previous thing of the storey.
    next(by) {
      const all = store.now.on(view.storey), now = all.findIndex((ref) => view.selected && ref.section === view.selected.section && ref.index === view.selected.index && ref.part === view.selected.part);
      if (!all.length) return;
      const ref = all[(now + by + all.length) % all.length], row = store.now.row(ref), at = view.lineOf(ref, row)?.[0] ?? store.now.rings(ref)[0]?.[0];
      act.select(ref);
      if (at) view.reveal(at);
      act.say(heading(singular(ref.section), row.name ?? row.stair ?? ""));
    },

    nextPart() {
      const { corner, side, door, ...ref } = view.selected ?? {}, rings = ref.section ? store.now.outlines(ref) : [];
      const parts = rings.flatMap((ring) => sidesOf2(ring).flatMap((one) => [{ corner: one[0] }, { side: one }])).concat(ref.section === "lifts" ? [{ door: true }] : []);
      const now = parts.findIndex((part) => door ? part.door : corner ? part.corner && keyOf(part.corner) === keyOf(corner) : side && part.side && keyOf(part.side[0]) === keyOf(side[0]));
      const part = parts[(now + 1) % parts.length];
      if (!OUTLINED.includes(ref.section)) return;
      act.select({ ...ref, ...part });
      act.say(part.door ? "Door" : part.corner ? `Corner ${part.corner.join(", ")}` : `Wall of ${length(minus(part.side[1], part.side[0])).toFixed(2)} m`);
    },

    async save() {
      isSaving = true;
      try {
        const { difference, digest: now } = await ask("save", { table: store.now.content, digest });
        [digest, onDisk, store.saved] = [now, now, store.now.content];
        by("banner").hidden = true;
        inspector.showChanges(difference, "Saved");
        showState();
        act.say(difference ? "Saved" : "Nothing to save");
        return true;
      } catch (error) {
        if (error.status === 409) warnOfFile(); else warn(error.message);
        return false;
      } finally {
        isSaving = false;
      }
    },

    saveAs() {
      by("copy-in").textContent = opened.working;
      by("copy-told").textContent = "";
      by("copy-to").showModal();
    },

    // Goes on with what is drawn in a new folder, at another address.
    async copyTo(folder) {
      try {
        const { address } = await ask("copy", { table: store.now.content, folder });
        store.saved = store.now.content;  // Else the browser asks.
        location.replace(address);
      } catch (error) {
        by("copy-told").textContent = error.message;
      }
    },

    warn: (text) => warn(text),

    // What is in the file, as one more step that can be undone.
    async takeFile() {
      const { table, digest: now } = await ask("document");
      [digest, onDisk, store.saved] = [now, now, table];
      by("banner").hidden = true;
      view.selected = null;
      store.commit(new Table(table));
    },

    keepMine() {
      digest = onDisk;
      by("banner").hidden = true;
      check();
    },

    theme() {
      const root = document.documentElement;
      root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
      view3d.isBuilt = false;
      view.draw();
      view3d.draw();
    },
  };
  const forms = new Forms(store, act, declared), inspector = new Inspector(store, view, act, forms, opened.loads);
  const tools = new Tools(store, view, act), running = new Running(view, view3d, act, isCase), designs = isCase ? new Designs(act) : null, timeline = isCase ? new Timeline(store, act) : null;
  const pictures = new Pictures(view, store, act);
  Object.assign(view, { tools, pictures });
  tools.pictures = pictures;

  function changed() {
    if (!store.now.storey(view.storey)) view.storey = store.now.storeys[0]?.name ?? "";
    if ([view.selected, ...view.also].some((ref) => ref && !store.now.row(ref))) Object.assign(view, { selected: null, also: [] });
    inspector.show(view.selected);
    inspector.showStoreys();
    forms.showRail(view.selected);
    timeline?.show(view.selected);
    locate();
    showState();
    view.draw();
    check();
  }

  function showState() {
    by("undo").disabled = !store.past.length;
    by("redo").disabled = !store.future.length;
    by("saved").textContent = store.isChanged ? "Not saved" : "Saved";
    by("saved").className = store.isChanged ? "changed" : "";
    running.mark(store.isChanged);
    document.title = `${store.isChanged ? "• " : ""}${opened.title} – evac edit`;
  }

  function warn(text, isOfFile = false) {
    by("banner").hidden = false;
    by("banner").className = isOfFile ? "" : "error";
    by("banner-text").textContent = text;
    for (const name of ["take-file", "keep-mine"]) by(name).hidden = !isOfFile;
  }

  async function warnOfFile() {
    onDisk = (await ask("document")).digest;
    warn(`${isCase ? `The case or ${opened.file}` : opened.file} has changed on the disk since it was read here. Nothing is overwritten:`, true);
  }

  // Has the plan kept in the journal and judged: each change at once, what is being dragged one after the other.
  async function check() {
    if (isSent || (tools.drag?.isMoved && (isAsked || lasted > AT_ONCE))) { isStale = true; return; }
    [isSent, isAsked, isStale] = [true, true, false];
    try {
      await ask("check", { page: PAGE, revision: store.revision, table: store.now.content });
    } catch (error) {
      isAsked = false;
      warn(error.message);
    }
    isSent = false;
    if (isStale && !tools.drag?.isMoved) check();
  }

  // Gives findings the thing that they are about, and a place.
  function locate() {
    for (const one of view.findings) {
      const [section, ...rest] = (one.item ?? "").split("."), name = rest.join("."), all = [store.now.rows(section)].flat(), index = all.findIndex((row, k) => (row.name ?? String(k)) === name);
      const ref = index < 0 ? null : { section, index }, row = ref && store.now.row(ref), line = ref && (view.lineOf(ref, row) ?? store.now.rings(ref)[0]);
      one.ref = section === "storeys" ? null : ref;
      one.tool = Object.keys(TOOLS).find((tool) => TOOLS[tool].section === one.item) ?? (section === "storeys" && ref && !row.like && !row.file && !store.now.on(name).length ? "room" : null);  // Nothing of the kind is there.
      if (!store.now.storey(one.storey)) one.storey = row?.storey ?? row?.lower ?? row?.storeys?.[0] ?? (section === "storeys" ? row?.name : one.storey);
      one.at = one.place?.slice(0, 2) ?? (line && middle(line));
    }
  }

  function showJudged({ page, revision, failed, errors, findings, building, difference, seconds }) {
    if (page !== PAGE) return;
    [isAsked, lasted] = [false, seconds ?? lasted];
    if (isStale) check();
    if (failed) return warn(failed);
    view.findings = findings;
    if (building) {
      const isFirst = !view.judged && !store.revision;
      view.judged = { ...building, hasExits: building.segments.exits.length > 0 };
      view.judgedRevision = revision;
      view3d.show({ building: building.three.building, floors: building.three.floors, origin: building.three.origin });
      if (isFirst) view.fit();  // With stairs outside the rooms.
    } else view.judgedRevision = -1;
    locate();
    inspector.showFindings(findings);
    if (store.isChanged) inspector.showChanges(difference, "Not saved yet");
    const warnings = findings.filter(({ kind }) => kind === "warning").length;
    by("verdict").textContent = errors ? `Cannot be run: ${errors} error${errors > 1 ? "s" : ""}` : `Can be run${warnings ? `: ${warnings} warning${warnings > 1 ? "s" : ""}` : ""}`;
    by("verdict").className = errors ? "error" : "";
    by("verdict").title = `judged in ${seconds} s`;
    by("verdict").dataset.revision = revision;
    if (!by("inspector").contains(document.activeElement)) inspector.show(view.selected);  // Else something is being typed.
    view.draw();
  }

  function showView(isIn3D) {
    by("view3d").hidden = !isIn3D;
    by("view").hidden = isIn3D;
    by("view-3d").setAttribute("aria-pressed", isIn3D);
    by("view-plan").setAttribute("aria-pressed", !isIn3D);
    if (isIn3D) view3d.draw(); else view.draw();
  }

  function listen() {
    const events = new EventSource("events"), on = (name, take) => events.addEventListener(name, ({ data }) => take(JSON.parse(data)));
    on("judged", showJudged);
    on("run", (state) => running.show(state));
    on("designs", (state) => designs?.show(state));
    on("changed", ({ digest: now }) => { if (!isSaving && now !== digest) { onDisk = now; warnOfFile(); } });
    events.addEventListener("error", () => { act.say("evac edit does not answer"); isLost = true; isAsked = false; });
    events.addEventListener("open", () => { if (isLost) act.say(""); isLost = isAsked = false; check(); });
  }

  const isUsable = (name) => (opened.is_drawn || UNDRAWN.includes(name)) && (isCase || !OF_CASE.includes(name));
  const fit = () => { if (by("view").hidden) view3d.fit(); else view.fit(); };
  const actions = { undo: () => store.undo(), redo: () => store.redo(), save: act.save, "save-as": act.saveAs, "view-plan": () => showView(false), "view-3d": () => showView(true), fit, theme: act.theme, "show-help": () => by("help").showModal(), "take-file": act.takeFile, "keep-mine": act.keepMine,
    "add-storey": () => { const name = store.now.unique("storeys", `storey ${store.now.storeys.length}`), top = store.now.storeys.at(-1), z = top ? mm((top.z ?? 0) + store.now.heightOf(top.name)) : 0; view.storey = name; store.commit(store.now.addStorey({ name, z, ...(top?.wall === undefined ? {} : { wall: top.wall }) })); act.say("Draw its rooms"); } };
  for (const [name, action] of Object.entries(actions)) by(name).addEventListener("click", action);
  by("copy").addEventListener("submit", (event) => { event.preventDefault(); act.copyUp(by("copies").valueAsNumber); });
  by("copy-form").addEventListener("submit", (event) => { event.preventDefault(); act.copyTo(by("copy-folder").value.trim()); });
  for (const [name, { key }] of Object.entries(TOOLS).filter(([name]) => isUsable(name))) {
    const button = node("button", capital(name), { type: "button", value: name });
    button.append(node("kbd", key.toUpperCase()));
    button.addEventListener("click", () => tools.choose(name));
    by("tools").append(button);
  }
  by("keys").tBodies[0].append(...KEYS.map(([keys, what]) => { const row = document.createElement("tr"); row.append(document.createElement("td"), node("td", what)); row.firstChild.append(node("kbd", keys)); return row; }));

  addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase(), isTyped = event.target.matches?.("input, select, textarea"), isControl = event.ctrlKey || event.metaKey;
    if (document.querySelector("dialog[open]")) return;
    const control = isControl && { z: event.shiftKey ? actions.redo : actions.undo, y: actions.redo, s: event.shiftKey ? act.saveAs : act.save, d: act.duplicate, a: act.selectAlike, enter: () => running.toggle() }[key];
    if (control && (!isTyped || key === "s" || key === "enter")) { event.preventDefault(); control(); return; }
    if (isTyped || isControl || event.altKey) return;
    if (event.target === view.canvas && tools.key(event)) return event.preventDefault();
    const tool = Object.keys(TOOLS).find((name) => TOOLS[name].key === key && isUsable(name));
    const other = { n: () => act.next(event.shiftKey ? -1 : 1), b: act.addNext, c: act.nextPart, i: () => by("inspector").querySelector("input")?.select(), delete: act.remove, backspace: act.remove, pageup: () => act.climb(1), pagedown: () => act.climb(-1), 3: () => showView(by("view3d").hidden), f: fit, "+": () => view.zoomAt(1.25, [view.x, view.y]), "-": () => view.zoomAt(0.8, [view.x, view.y]), t: act.theme, "?": actions["show-help"], escape: () => { if (tools.points.length || tools.tool === "select") tools.cancel(); else tools.choose("select"); act.select(null); view.canvas.focus(); } }[key];
    if (!tool && !other) return;
    event.preventDefault();
    if (tool) tools.choose(tool); else other();
  });
  addEventListener("resize", () => { view.draw(); view3d.draw(); timeline?.show(view.selected); });
  addEventListener("beforeunload", (event) => { if (store.isChanged) event.preventDefault(); });

  document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  by("title").textContent = opened.title;
  act.toolChanged();
  view.fit();
  if (opened.unsaved) {
    store.commit(new Table(opened.unsaved.table));
    act.say(`What was not saved is here again${opened.unsaved.of_this_file ? "" : "; the file has changed since"}: undo for what is in the file`);
  } else {
    changed();
    act.say(`In ${opened.folder}`);
  }
  inspector.showChanges("", "Changes of the file");
  listen();
  window.editor = { store, pictures, view, view3d, tools, act, running };
}

function failed(error) {
  by("banner").hidden = false;
  by("banner").className = "error";
  by("banner-text").textContent = error.message;
}

start().catch(failed);

// Mouse, touch and keyboard.

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20, 50];

// What the help says: keys, what they do, and, by the name of each key, the action; then the pointer.
function keysOf(camera, state, act) {
  const view = (change) => () => { change(); act.look(); };
  return [
    ["Space or K", "play or pause", { " ": act.toggle, k: act.toggle }],
    ["← →", "one recorded state back or forward; with Shift 10 s", { arrowleft: (isLong) => act.step(-1, isLong), arrowright: (isLong) => act.step(1, isLong) }],
    ["Home, End", "to the start, to the end", { home: () => act.seek(-Infinity), end: () => act.seek(Infinity) }],
    ["[ ]", "slower, faster", { "[": () => act.faster(-1), "]": () => act.faster(1) }],
    ["P", "3D, plan or section", { p: act.nextView }],
    ["Page up, Page down", "next level up or down; all levels beyond the last", { pageup: () => act.climb(1), pagedown: () => act.climb(-1) }],
    ["C", "next colour of people", { c: act.recolour }],
    ["L", "next map on the floors", { l: act.nextLayer }],
    ["M", "measure with a line, an area, off", { m: act.nextMeasure }],
    ["H, X", "paths; show only what is in a box", { h: () => act.paths(), x: act.showClip }],
    ["F, 0", "show everything; return to the first view", { f: act.fit, "0": act.restart }],
    ["+ −", "zoom", { "+": view(() => camera.zoom(0.8)), "=": view(() => camera.zoom(0.8)), "-": view(() => camera.zoom(1.25)) }],
    ["W A S D", "move", { w: view(() => camera.pan(0, -0.1)), s: view(() => camera.pan(0, 0.1)), a: view(() => camera.pan(0.1, 0)), d: view(() => camera.pan(-0.1, 0)) }],
    ["Q E, R V", "turn, tilt", { q: view(() => camera.orbit(0.12, 0)), e: view(() => camera.orbit(-0.12, 0)), r: view(() => camera.orbit(0, 0.1)), v: view(() => camera.orbit(0, -0.1)) }],
    ["I, T, ?", "about this run, light or dark, these keys", { i: () => by("info").showModal(), t: act.theme, "?": () => by("help").showModal() }],
    ["N, B", "next event, previous event", { n: () => act.nextEvent(1), b: () => act.nextEvent(-1) }],
    ["G", "follow the selected person", { g: () => act.follow(state.selected !== null && !state.isFollowed) }],
    ["Escape", "deselect, close", { escape: act.deselect }],
    ["Drag, one finger", "turn (in plan and section: move)"],
    ["Shift or right drag, two fingers", "move; two fingers zoom as well"],
    ["Wheel", "zoom to the pointer"],
    ["Click, tap", "select a person"],
  ];
}

// Calls `act` with the names of what the pointers on the canvas do.
function listenToPointers(canvas, camera, act) {
  const pointers = new Map();
  let moved = 0, isDrawing = false;
  const middle = () => {
    const all = [...pointers.values()];
    const [x, y] = [0, 1].map((i) => all.reduce((sum, at) => sum + at[i], 0) / all.length);
    const apart = all.length > 1 ? Math.hypot(all[0][0] - all[1][0], all[0][1] - all[1][1]) : 0;
    return [x, y, apart];
  };
  const place = (x, y) => {
    const box = canvas.getBoundingClientRect();
    return [2 * (x - box.left) / box.width - 1, 1 - 2 * (y - box.top) / box.height];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    moved = pointers.size > 1 ? 99 : 0;
    isDrawing = pointers.size === 1 && act.draw(...place(event.clientX, event.clientY), true);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const [x, y, apart] = middle();
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (isDrawing) return act.draw(...place(event.clientX, event.clientY), false);
    const [nx, ny, now] = middle(), { clientWidth: width, clientHeight: height } = canvas;
    moved += Math.hypot(nx - x, ny - y);
    if (moved < 4) return;
    if (apart && now) camera.zoom(apart / now, ...place(nx, ny));
    if (camera.isFlat || pointers.size > 1 || event.shiftKey || event.buttons & 6) camera.pan(2 * (nx - x) / width, -2 * (ny - y) / height);
    else camera.orbit(4 * (nx - x) / height, 3 * (ny - y) / height);
    act.look();
  });
  const release = (event) => {
    if (event.type === "pointerup" && pointers.has(event.pointerId) && moved < 4 && !isDrawing) act.click(...place(event.clientX, event.clientY));
    pointers.delete(event.pointerId);
  };
  for (const type of ["pointerup", "pointercancel"]) canvas.addEventListener(type, release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(0.0015 * Math.max(-300, Math.min(300, event.deltaY * (event.deltaMode ? 20 : 1)))), ...place(event.clientX, event.clientY));
    act.look();
  }, { passive: false });
}

function listenToKeys(camera, state, act) {
  const all = keysOf(camera, state, act), actions = Object.assign({}, ...all.map(([, , action]) => action));
  by("keys").tBodies[0].innerHTML = all.map(([keys, what]) => `<tr><td><kbd>${keys}</kbd></td><td>${what}</td></tr>`).join("");
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const at = event.target, key = event.key.toLowerCase(), isArrow = key === "arrowleft" || key === "arrowright";
    const isTyped = at.matches?.("select, input:not([type=range])") || (at.matches?.("button") && (key === " " || key === "enter"));
    if (isTyped || !actions[key] || isArrow && at.matches?.("input") && at.id !== "slider") return;
    actions[key](event.shiftKey);
    event.preventDefault();
  });
}

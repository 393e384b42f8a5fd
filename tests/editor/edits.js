// Fifty random edits with the functions of the page; returns how many steps can be undone.
(seed) => {
  const { store, act, view, tools } = editor;
  const words = ["move", "rename", "remove", "duplicate", "wall", "corner", "copy", "line", "room", "key", "people"];
  let state = seed + 1;
  const draw = () => (state = state * 16807 % 2147483647) / 2147483647, pick = (list) => list[Math.floor(draw() * list.length)];
  const off = () => [Math.round(draw() * 20) / 10, Math.round(draw() * 20) / 10];
  for (let k = 0; k < 50; k++) {
    if (!store.now.storeys.length) break;
    act.goTo(pick(store.now.storeys).name);
    const ref = pick(store.now.on(view.storey)), row = ref && store.now.row(ref);
    const what = document.body.classList.contains("fixed") ? "people" : pick(words);
    const sides = store.now.walls(view.storey), side = pick(sides);
    if (what === "people") store.commit(store.now.put({ section: "people", index: 0 }, "number", 1 + Math.floor(draw() * 90)));
    else if (what === "copy" && store.now.storeys.length < 6) store.commit(store.now.copyUp(view.storey, 1));
    else if (what === "room") { tools.choose("room"); const at = off(); tools.finish([at, [at[0] + 3, at[1]], [at[0] + 3, at[1] + 2], [at[0], at[1] + 2]]); }
    else if (what === "line" && side) { tools.choose(pick(["door", "exit"])); tools.finish([[(side[0][0] + side[1][0]) / 2, (side[0][1] + side[1][1]) / 2]]); }
    else if (what === "wall" && side) store.commit(store.now.moveWall(view.storey, side, off()));
    else if (what === "corner" && side) store.commit(store.now.moveCorners(view.storey, new Set([side[0].map((value) => Math.round(value * 1000) / 1000).join()]), off()));
    else if (!row) continue;
    else if (what === "move") store.commit(store.now.moveRow(ref, off()));
    else if (what === "rename" && ref.part === undefined) store.commit(store.now.rename(ref, `new "${k}" \u00e9`));
    else if (what === "key" && ref.part === undefined) store.commit(store.now.put(ref, pick(["use", "width", "z"]), pick([1.5, undefined])));
    else if (what === "remove" || what === "duplicate") { act.select(ref); act[what](); }
  }
  return store.past.length;
}

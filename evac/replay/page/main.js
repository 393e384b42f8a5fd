// Puts everything together, and shows the time that is to be shown.

const WHOLE = [0, 0, 0, 1, 1, 1];  // Shares of the building that are shown: least x, y and z, greatest x, y and z.
const VIEWS = ["3d", "plan", "section"];
const CLIPPED = ["from x", "from y", "from z", "to x", "to y", "to z"];
const MEASURED = "measured";  // Name of its curves.
const FOLLOWED = 14;  // Height of the picture around somebody who is followed [m].
const MOST_PIXELS = 2;  // Of the screen to one of the page, at most.
const LEAST_PIXELS = 0.6;
const SLOW_FRAME = 60;  // [ms]
const TELL_EVERY = 120;  // While it plays, numbers are shown this often, and the density of many people [ms].
const SHADOWED = 3000;  // So many people have shadows.

const NAME = 20, ROOM_OF_SCALE = 30, ROOM_OF_ARROW = 52;  // For names of storeys above plans, and the scale and the arrow to the north below [pixels].

const following = (all, one) => all[(all.indexOf(one) + 1) % all.length];
const heightOfTools = () => by("tools").offsetHeight + 20;  // They lie over the picture.

async function start() {
  const about = JSON.parse(new TextDecoder().decode(await inflate("about")));
  const streams = await inflateMotion();
  const motion = unpackMotion(streams, about);
  const record = new Record(about, motion);
  const storeys = findStoreys(about.building.levels);
  const layout = new Layout(about.building, about.grain, storeys);
  const density = new Density(about.building, new Uint8Array(await inflate("floors")), about.people_scales.density.top);
  const smoke = about.smoke && new Smoke(streams.smoke, about, record.frames, density), airs = smoke ? AIR : [];
  const lacking = [...(smoke ? [] : AIR), ...(motion.dose.length ? [] : ["dose"])];
  const maps = new Maps(record, density), layers = ["plain", ...airs, "density now", ...Object.keys(about.map_scales)];
  const quantities = ["group", ...Object.keys(about.people_scales)].filter((name) => !lacking.includes(name));
  const series = new Series(record, storeys);
  const people = new People(record, density, smoke);
  const canvas = by("view"), camera = new Camera(), stage = new Stage(canvas, record.people);
  const labels = new Labels(by("labels"), record, layout);
  const panel = new Panel(record, series, layout, people);
  const atFirst = { time: record.begin, speed: 1, quantity: motion.dose.length ? "dose" : "group", view: "3d", storey: -1, layer: airs[0] ?? "plain", service: "", highlighted: null, hasPaths: false, clip: WHOLE };
  const state = { ...atFirst, isPlaying: false, spread: 1, selected: null, isFollowed: false, measuring: "", pixels: MOST_PIXELS, took: 0 };
  drawBars(record.safety, record);
  listMargins(record.margins, (person, time) => { act.seek(time); act.select(person); });
  const timeLine = new TimeLine(findEvents(record, series), record, (time) => act.seek(time));
  const chart = new Chart(by("chart"), record, series, (time) => act.seek(time));
  let look = {}, built = null, isStale = true, last = null, told = 0, felt = 0;
  let measured = null, drawnFrom = null;
  let opened = null, remembering = null, film = null, fitted = "";

  const redraw = () => {
    if (!isStale) requestAnimationFrame(show);
    isStale = true;
  };
  const aspect = () => canvas.clientWidth / Math.max(1, canvas.clientHeight);

  function fit() {
    camera.isFlat = state.view !== "3d";
    if (camera.isFlat) camera.azimuth = 0;
    camera.fit(layout.corners(), 1.08);
    const isPlan = state.view === "plan", left = state.storey < 0 && !isPlan ? labels.margin() : 0, top = heightOfTools() + (isPlan ? NAME : 0), bottom = about.northward ? ROOM_OF_ARROW : camera.isFlat ? ROOM_OF_SCALE : 0;
    camera.makeRoom(layout.corners(), Math.min(0.3, left / canvas.clientWidth), Math.min(0.6, top / canvas.clientHeight), Math.min(0.15, bottom / canvas.clientHeight));
    fitted = camera.place();
    redraw();
  }

  function arrange() {
    layout.arrange(state.view, state.storey, state.spread, aspect());
    built = null;
    for (const view of VIEWS) by(`view-${view}`).setAttribute("aria-pressed", view === state.view);
    by("storey-tool").hidden = storeys.length < 2 || state.view === "section";
    by("storey").value = state.storey;
    by("spread-tool").hidden = state.view !== "3d" || state.storey >= 0 || storeys.length < 2;
    by("clip").hidden = state.view !== "3d";
    if (state.view !== "3d") by("clip-box").hidden = true;
    redraw();
  }

  function setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    const style = getComputedStyle(document.documentElement), of = (name) => unit(style.getPropertyValue(`--${name}`).trim());
    look = { background: of("ground"), floors: ["floor", "flight", "landing"].flatMap(of), solids: ["wall", "wall-top", "desk"].flatMap(of), marks: [-1, -1, -1, ...about.colours.marks.flatMap(unit)], mark: of("mark"), rim: of("text") };
    recolour();
    select(state.selected);
  }

  function recolour() {
    by("colour").value = state.quantity;
    showLayer();
    panel.showLegend(state.quantity, state.service, state.highlighted, (index) => { state.highlighted = index; recolour(); drawPaths(); });
    redraw();
  }

  // Shows a map on the floors; those of the whole run are computed when the first of them is chosen.
  function showLayer() {
    const { layer } = state, isNow = layer === "density now";
    const isAir = airs.includes(layer), ofNow = isNow ? "density" : isAir ? layer : null;
    const map = served(ofNow ? { ...people.scaleOf(ofNow, ""), isVeiled: layer !== AIR[1] } : about.map_scales[layer], state.service, about.services);
    by("layer").value = layer;
    by("layer-legend").hidden = !map;
    by("service").value = state.service;
    by("service-tool").hidden = !map?.isDensity && state.quantity !== "density";
    state.isLayered = Boolean(map) && (ofNow !== null || maps.share === 1);
    if (map && !ofNow) maps.find(showLayer);
    if (state.isLayered) {
      const top = map.top ?? maps.ends[layer];
      stage.setScale(layered(ramp(map), map.isVeiled, layer === AIR[1]));
      if (!isAir) stage.setLayer(density, isNow ? density.bytes : maps.bytes(layer, map, top), map.isVeiled);
      const name = isNow ? "Density" : capital(layer);
      by("layer-legend").innerHTML = `<div class="ends"><span>${name} on the floors</span></div>${bar(onFloor(map, look.floors.slice(0, 3)), map, top, "transparent")}${isAir ? noteOf(aboutAir(layer, about.smoke)) : ""}`;
    } else by("layer-legend").innerHTML = `<div class="ends"><span>Computing maps: ${Math.round(100 * maps.share)} %</span></div>`;
    felt = 0;
    redraw();
  }

  function selectedPlace() {
    if (people.marked < 0) return null;
    const [x, y, z] = people.bodies.subarray(4 * people.marked, 4 * people.marked + 3);
    return { name: `Person ${state.selected}`, at: [x, y, z + (camera.isFlat ? 0 : record.height[state.selected] / 1000)] };
  }

  // Name and place of the event at the time that is shown.
  function eventPlace() {
    const { text, at: { level, x, y } = {} } = timeLine.placed(state.time) ?? {};
    if (!layout.visible[level]) return null;
    const [c, a, b] = layout.building.levels[level].plane;
    return { name: text, at: layout.place(level, x, y, c + a * x + b * y + (camera.isFlat ? 0 : 1)) };
  }

  // Writes what is shown to the address, a little later. A frame within another page has no address of its own.
  function remember() {
    if (location.protocol === "about:" || !opened) return;
    clearTimeout(remembering);
    remembering = setTimeout(() => {
      const fragment = addressOf(describeView(state, camera), opened);
      history.replaceState(null, "", fragment ? `#${fragment}` : location.href.split("#")[0]);
    }, WAIT);
  }

  // Shows what the fragment of the address says.
  function goToAddress() {
    const known = { storeys: storeys.length, layers, quantities, services: Object.keys(about.services), people: record.people, groups: record.groups.length };
    const { azimuth, tilt, size, target, view, selected, ...others } = readAddress(location.hash.slice(1), known);
    act.view(view ?? state.view);
    Object.assign(state, others);
    act.clip(others.clip ?? WHOLE);
    Object.assign(camera, { tilt: tilt ?? camera.tilt, azimuth: azimuth ?? camera.azimuth });
    by("spread").value = state.spread;
    arrange();
    fit();
    Object.assign(camera, { size: size ?? camera.size, target: target ?? camera.target });
    select(selected ?? null);
    recolour();
    act.seek(state.time);
  }

  // Returns a picture of what has just been drawn, with texts; on a page if one is given.
  function paint(page) {
    const scale = state.quantity === "group" ? null : people.scaleOf(state.quantity, state.service);
    const told = scale && { ...scale, name: state.quantity, most: scale.top, nothing: record.colours.nothing, stops: onFloor({ ...scale, isVeiled: false }, [0, 0, 0]) };
    const words = `${seconds(state.time)} · ${by("inside").textContent} inside, ${by("outside").textContent} out`;
    return paintPicture(canvas, { labels: labels.shown, title: document.title, about: words, legend: { scale: told, groups: panel.groupNames }, top: heightOfTools() }, page);
  }

  function paintNow() {
    show();
    return paint();
  }

  // Plays from this time on at this speed, and saves that as a video at the end or when it is stopped.
  function toggleFilm() {
    if (film) return pause();
    if (state.time >= record.end) state.time = record.begin;
    film = startFilm(paintNow(), "replay");
    if (!film) return tellFilm("no video here");
    tellFilm("Stop video");
    if (!state.isPlaying) act.toggle();
  }

  function tellFilm(text) { by("save-film").textContent = text; }

  // Prints are light, and have a picture in the place of the canvas.
  function preparePrint() {
    const { theme } = document.documentElement.dataset;
    setTheme("light");
    by("printed").src = paintNow().toDataURL("image/png");
    by("printed").hidden = false;
    addEventListener("afterprint", () => {
      by("printed").hidden = true;
      setTheme(theme);
    }, { once: true });
  }

  // Keeps whoever is followed in the middle of the picture, on the level that is shown.
  function goAlong(now) {
    const i = now.person.subarray(0, now.count).indexOf(state.selected);
    if (i < 0) return;
    const { storey } = about.building.levels[now.level[i]], place = layout.place(now.level[i], now.x[i], now.y[i], now.z[i]);
    if (state.storey >= 0 && state.storey !== storey) {
      state.storey = storey;
      arrange();
    }
    camera.target = place;
    camera.update();
  }

  function drawPaths() {
    const { highlighted } = state, last = about.colours.groups.length - 1;
    const isOfThem = (p) => highlighted === null || (record.group[p] < 0 ? last : record.group[p]) === highlighted;
    by("paths").setAttribute("aria-pressed", state.hasPaths);
    stage.mesh("paths", state.hasPaths ? pathsMesh(layout, record, isOfThem, about.colours.groups.map(([body]) => unit(body))) : [], [3, 4]);
    redraw();
  }

  function drawMeasured() { stage.mesh("measured", measured ? measureMesh(layout, measured, look.mark) : [], [3, 4]); }

  function showMeasured() {
    by("measured-section").hidden = !measured;
    drawMeasured();
    by("measured-name").textContent = measured ? capital(measured.name) : "";
    delete chart.curves[MEASURED];
    if (measured) chart.curves[MEASURED] = measured.curves();
    options("curve", Object.keys(chart.curves).map((name) => [name, name]));
    showCurve(measured ? MEASURED : by("curve").value);
  }

  function showCurve(name) {
    by("curve").value = name;
    chart.show(name);
    redraw();
  }

  function options(id, entries) {
    by(id).innerHTML = entries.map(([value, text]) => `<option value="${escaped(value)}">${escaped(text)}</option>`).join("");
  }

  function select(p) {
    state.selected = p;
    if (p === null) act.follow(false);
    stage.mesh("track", p === null ? [] : trackMesh(layout, record, p, look.mark), [3, 4]);
    redraw();
  }

  function show() {
    isStale = false;
    const began = performance.now();
    const pixels = Math.min(devicePixelRatio, state.pixels), { clientWidth: wide, clientHeight: tall } = canvas;  // Read before the page is changed.
    const [width, height] = [Math.round(wide * pixels), Math.round(tall * pixels)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    if (camera.aspect !== aspect()) {
      camera.aspect = aspect();
      if (camera.place() === fitted) { arrange(); fit(); }  // Another size of the window shows the same.
    }
    camera.update();
    const building = record.stateAt(state.time);
    if (built !== building) {
      built = building;
      stage.build(layout, density, building, { exit: unit(about.colours.exit), closed: unit(about.colours.closed), places: Object.fromEntries(Object.entries(about.colours.places).map(([kind, colour]) => [kind, unit(colour)])) });
      select(state.selected);
      drawMeasured();
      drawPaths();
    }
    const now = record.at(state.time);
    const isLate = began - felt > TELL_EVERY || !state.isPlaying || now.count < SHADOWED;
    const isNow = state.layer === "density now";
    if (isLate && (isNow || state.quantity === "density")) {
      felt = began;
      density.update(now);
      if (isNow) stage.setLayer(density, density.bytes, true);
    }
    if (airs.includes(state.layer)) stage.setLayer(density, smoke.layer(state.layer, now.frame, people.scaleOf(state.layer, "")), true);
    people.update(now, layout, state.quantity, state.service, state.highlighted, state.selected);
    if (state.isFollowed) goAlong(now);
    const cars = carsAt(record, now, state.time);
    if (cars.length) stage.mesh("cars", carsMesh(layout, cars, unit(about.colours.car)), [3, 4]);
    stage.draw(camera, people, { ...look, ...layout.boxInPicture(), layer: state.isLayered ? 1 : 0, isSmoky: state.layer === AIR[0], limit: smoke?.limitOf(state.layer, people) ?? -1, shadows: people.count <= SHADOWED || state.selected !== null, widen: people.count <= SHADOWED ? 1 : 0.8 });
    labels.update(camera, building, selectedPlace(), eventPlace(), carPlaces(layout, cars, camera.isFlat), people, density, wide, tall);
    updateScale(camera, tall, about.northward, state.view === "section");
    if (film) paint(film.page);
    if (!state.isPlaying || began - told > TELL_EVERY) tell(now);
    if (!state.isPlaying) remember();
  }

  function tell(now) {
    told = performance.now();
    panel.update(state.time, now);
    panel.tellPerson(state.selected, state.time, now);
    chart.update(state.time);
    if (measured) by("measured-facts").innerHTML = asTerms(measured.facts(state.time));
    timeLine.update(state.time);
    by("slider").value = state.time;
    by("slider").setAttribute("aria-valuetext", `${seconds(state.time)}, ${series.inside.at(state.time)} people inside`);
  }

  function play(time) {
    if (!state.isPlaying) return;
    if (last !== null) {
      spare(time - last);
      state.time = Math.min(record.end, state.time + state.speed * Math.min(0.25, (time - last) / 1000));
    }
    last = time;
    if (state.time >= record.end) pause();
    isStale = true;
    show();
    if (state.isPlaying) requestAnimationFrame(play);
  }

  // Where drawing is slow, motion is shown with fewer pixels; a picture that stands has all.
  function spare(took) {
    state.took = 0.8 * state.took + 0.2 * Math.min(took, 400);
    if (state.took < SLOW_FRAME || state.pixels <= LEAST_PIXELS) return;
    Object.assign(state, { pixels: Math.max(LEAST_PIXELS, 0.8 * Math.min(state.pixels, devicePixelRatio)), took: 0 });
  }

  function pause() {
    film?.end();
    if (film) tellFilm("Video");
    film = null;
    Object.assign(state, { pixels: MOST_PIXELS, took: 0 });
    showPlaying(false);
    redraw();
  }

  function showPlaying(isPlaying) {
    state.isPlaying = isPlaying;
    Object.assign(by("play"), { textContent: isPlaying ? "❚❚" : "▶", ariaLabel: isPlaying ? "Pause" : "Play" });
  }

  const act = {
    look: redraw,
    restart() {
      pause();
      Object.assign(state, atFirst);
      for (const dialog of document.querySelectorAll("dialog[open]")) dialog.close();
      act.speed(1);
      act.measure("");
      act.clip(WHOLE);
      by("clip-box").hidden = true;
      select(null);
      recolour();
      camera.aspect = aspect();
      state.spread = chooseView(camera, layout, density, record).spread;
      camera.turned = camera.azimuth;
      by("spread").value = state.spread;
      arrange();
      fit();
    },
    fit,
    toggle() {
      if (state.isPlaying) return pause();
      if (state.time >= record.end) state.time = record.begin;
      last = null;
      showPlaying(true);
      requestAnimationFrame(play);
    },
    seek(time) { state.time = Math.max(record.begin, Math.min(record.end, time)); redraw(); },
    step(by, isLong) {
      if (isLong) return act.seek(state.time + 10 * by);
      const k = record.frameAt(state.time), isBetween = state.time > motion.times[k] + 1e-9;
      act.seek(motion.times[Math.max(0, Math.min(record.frames - 1, k + (by < 0 && isBetween ? 0 : by)))]);
    },
    faster(by) { act.speed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(state.speed) + by))]); },
    speed(speed) { state.speed = speed; by("speed").value = speed; },
    nextView() { act.view(following(storeys.length > 1 ? VIEWS : VIEWS.slice(0, 2), state.view)); },
    view(view) {
      if (view === state.view) return;
      if (state.view === "3d") camera.turned = camera.azimuth; else if (view === "3d") camera.azimuth = camera.turned;
      state.view = view;
      if (view === "section") state.storey = -1;
      arrange();
      fit();
    },
    climb(by) { act.storey(Math.max(-1, state.storey + by >= storeys.length ? -1 : state.storey < 0 && by < 0 ? storeys.length - 1 : state.storey + by)); },
    storey(storey) { if (storeys.length > 1) { state.storey = storey; arrange(); fit(); } },
    spread(spread) { state.spread = spread; arrange(); fit(); },
    recolour() { act.colour(following(quantities, state.quantity)); },
    colour(quantity) { state.quantity = quantity; recolour(); },
    service(service) { state.service = service; recolour(); },
    nextLayer() { act.layer(following(layers, state.layer)); },
    layer(layer) { state.layer = layer; showLayer(); },
    theme() { setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"); },
    select,
    // The next person, after the one selected, who has a number, or is in a group of a name.
    find(text) {
      const wanted = text.trim().toLowerCase(), isNumber = /^\d+$/.test(wanted), { selected } = state;
      const fits = (p) => isNumber ? p === Number(wanted) : record.group[p] >= 0 && record.groups[record.group[p]].toLowerCase().includes(wanted);
      const found = wanted ? [...record.group.keys()].filter(fits) : [];
      by("found").textContent = found.length || !wanted ? "" : isNumber ? `People are numbered from 0 to ${record.people - 1}.` : "There is no such group.";
      if (found.length) act.select(found.find((p) => p > selected) ?? found[0]);
    },
    paths(isShown = !state.hasPaths) { state.hasPaths = isShown; drawPaths(); },
    clip(shares) {
      state.clip = shares;
      layout.clip(shares);
      by("clip").setAttribute("aria-pressed", layout.isClipped);
      CLIPPED.forEach((name, k) => { by(`clip-${k}`).value = shares[k]; });
      redraw();
    },
    showClip() {
      if (state.view === "3d") by("clip-box").hidden = !by("clip-box").hidden;
      if (camera.place() === fitted) fit();  // The tools are higher.
    },
    follow(isFollowed) {
      state.isFollowed = isFollowed;
      by("follow").setAttribute("aria-pressed", isFollowed);
      if (isFollowed) camera.size = Math.min(camera.size, FOLLOWED);
      redraw();
    },
    // Lets the user draw a line or an area; with neither, nothing is measured any more.
    measure(kind) {
      state.measuring = by("measure").value = kind;
      canvas.classList.toggle("drawing", Boolean(kind));
      if (kind) return;
      measured = null;
      showMeasured();
    },
    nextMeasure() { act.measure(following(["", "line", "area"], state.measuring)); },
    // Draws from or to a place on the screen; returns whether something is drawn.
    draw(x, y, isStart) {
      if (!state.measuring) return false;
      camera.update();
      const at = meetFloor(layout, density, camera.ray(x, y));
      if (isStart) drawnFrom = at;
      else if (at && drawnFrom && at.level === drawnFrom.level && Math.hypot(at.x - drawnFrom.x, at.y - drawnFrom.y) > 0.1) {
        measured = new Measured(state.measuring, drawnFrom, at, record, density);
        showMeasured();
      }
      return drawnFrom !== null;
    },
    nextEvent(by) { act.seek(timeLine.next(state.time, by) ?? state.time); },
    deselect() { select(null); },
    click(x, y) { camera.update(); const p = people.pick(camera.ray(x, y)); select(p < 0 ? null : p); },
  };

  const dark = matchMedia("(prefers-color-scheme: dark)");
  const follow = () => setTheme(dark.matches ? "dark" : "light");
  dark.addEventListener("change", follow);
  fillChoices();
  listen();
  isStale = false;
  follow();
  act.restart();
  opened = describeView(state, camera);
  if (location.hash) goToAddress();
  addEventListener("hashchange", goToAddress);
  addEventListener("beforeprint", preparePrint);
  by("loading").hidden = true;
  new ResizeObserver(redraw).observe(canvas);
  return { record, layout, density, smoke, maps, series, people, labels, camera, state, act, stage, chart, get measured() { return measured; } };

  function fillChoices() {
    options("storey", [[-1, "all"], ...storeys.map((storey, index) => [index, storey.name])]);
    by("view-section").hidden = storeys.length < 2;
    options("colour", quantities.map((name) => [name, capital(name)]));
    options("layer", layers.map((name) => [name, name]));
    options("service", [["", "none"], ...Object.entries(about.services).map(([name, { source }]) => [name, source])]);
    options("speed", SPEEDS.map((speed) => [speed, `${speed}×`]));
    by("clip-box").innerHTML = CLIPPED.map((name, k) => `<label>${name} <input id="clip-${k}" type="range" min="0" max="1" step="0.01" value="${WHOLE[k]}"></label>`).join("");
    by("speed").value = state.speed;
    Object.assign(by("slider"), { min: record.begin, max: record.end });
    Object.assign(by("spread"), { min: 1, max: MOST_SPREAD });
  }

  function listen() {
    const on = (id, type, action) => by(id).addEventListener(type, action);
    const clicks = {
      play: act.toggle, paths: () => act.paths(), clip: act.showClip, fit, theme: act.theme, "show-info": () => by("info").showModal(), "show-help": () => by("help").showModal(),
      "person-close": act.deselect, follow: () => act.follow(!state.isFollowed), "measured-close": () => act.measure(""),
    };
    for (const [id, action] of Object.entries(clicks)) on(id, "click", action);
    for (const view of VIEWS) on(`view-${view}`, "click", () => act.view(view));
    for (const id of ["layer", "colour", "service", "measure"]) on(id, "change", () => act[id](by(id).value));
    CLIPPED.forEach((name, k) => on(`clip-${k}`, "input", () => act.clip(CLIPPED.map((_, i) => Number(by(`clip-${i}`).value)))));
    for (const id of ["speed", "storey", "spread"]) on(id, "input", () => act[id](Number(by(id).value)));
    on("slider", "input", () => act.seek(Number(by("slider").value)));
    on("save-film", "click", toggleFilm);
    on("save-picture", "click", () => savePicture(paintNow(), `replay-${state.time.toFixed(1)}-s.png`));
    on("curve", "change", () => showCurve(by("curve").value));
    on("measured-save", "click", () => save(new Blob([measured.table(), "\n"], { type: "text/csv" }), `${measured.name}.csv`));
    for (const id of ["warnings", "answer"]) on(id, "click", ({ target }) => {
      if (!target.matches("button")) return;
      by("info").close();
      act.seek(Number(target.value));
    });
    on("search", "submit", (event) => { event.preventDefault(); act.find(by("find").value); });
    listenToPointers(canvas, camera, act);
    listenToKeys(camera, state, act);
  }
}

start().then((replay) => { window.replay = Object.assign(replay, { opened: performance.now() }); }, (error) => {
  document.documentElement.className = "plain";
  Object.assign(by("loading"), { hidden: false, className: "failed", textContent: `The replay cannot be shown: ${error.message}` });
  throw error;
});

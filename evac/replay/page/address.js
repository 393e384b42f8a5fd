// The view in the fragment of the address, so that a link leads to it.

const WAIT = 300;  // The address follows so late [ms].
const VIEWED = ["view", "storey", "spread", "quantity", "layer", "service", "selected", "highlighted", "hasPaths", "clip"];
const AIMED = ["azimuth", "tilt", "size"];
const digits = (value) => typeof value === "number" ? Number(value.toPrecision(6)) : value;

// What is shown, as texts by name.
function describeView(state, camera) {
  const named = (names, of) => names.map((name) => [name, String(digits(of[name]) ?? "")]);
  return [...named(["time", ...VIEWED], state), ...named(AIMED, camera), ["target", String(camera.target.map(digits))]];
}

// The fragment of what is shown: only what is not as it opens.
function addressOf(shown, opened) {
  return new URLSearchParams(shown.filter(([, value], k) => value !== opened[k][1])).toString();
}

// The entries of a fragment that are valid; a link may come from anywhere.
function readAddress(fragment, { storeys, layers, quantities, services, people, groups }) {
  const given = new URLSearchParams(fragment), found = {};
  const among = { view: VIEWS, layer: layers, quantity: quantities, service: services };
  for (const [name, values] of Object.entries(among)) if (values.includes(given.get(name))) found[name] = given.get(name);
  const ranges = { time: [-Infinity, Infinity], storey: [-1, storeys - 1], spread: [1, MOST_SPREAD], azimuth: [-100, 100], tilt: [0.08, 1.55],
                   size: [0.5, 1e5], selected: [0, people - 1], highlighted: [0, groups] };
  for (const [name, [low, high]] of Object.entries(ranges)) {
    const value = given.get(name) ? Number(given.get(name)) : NaN, isWhole = ["storey", "selected", "highlighted"].includes(name);
    if (value >= low && value <= high && (!isWhole || Number.isInteger(value))) found[name] = value;
  }
  if (given.get("hasPaths") === "true") found.hasPaths = true;
  const clip = given.get("clip")?.split(",").map(Number);
  if (clip?.length === 6 && clip.every((share) => share >= 0 && share <= 1)) found.clip = clip;
  const target = given.get("target")?.split(",").map(Number);
  if (target?.length === 3 && target.every(Number.isFinite)) found.target = target;
  return found;
}

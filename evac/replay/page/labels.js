// Names of exits, stairs, storeys and places over the picture.

class Labels {
  constructor(node, record, layout) {
    this.node = node;
    this.record = record;
    this.layout = layout;
    const { building, grain } = record;
    this.items = building.exits.map((exit, index) => {
      const s = 6 * Math.floor(exit.segments.length / 12);
      const [x1, y1, z1, x2, y2, z2] = exit.segments.slice(s, s + 6).map((value) => value * grain);
      return { kind: "exit", index, name: exit.name, level: exit.level, at: [(x1 + x2) / 2, (y1 + y2) / 2, (z1 + z2) / 2], out: outside(x1, y1, x2, y2), lift: EXIT_HEIGHT + 0.1 };
    });
    layout.storeys.forEach((storey, index) => {
      if (layout.storeys.length < 2) return;
      const level = building.levels.findIndex((one) => one.storey === index && one.kind === "floor");
      this.items.push({ kind: "storey", index, name: storey.name, level, at: [layout.box[0], layout.box[1], storey.z], lift: 0 });
    });
    building.stairs.forEach((stair, index) => {
      const level = stair.levels[Math.floor(stair.levels.length / 2)];
      const sum = [0, 0, 0], { triangles } = building.levels[level];
      for (const v of triangles) for (const i of [0, 1, 2]) sum[i] += building.vertices[3 * v + i] * grain / triangles.length;
      this.items.push({ kind: "stair", index, name: /stair/i.test(stair.name) ? stair.name : `stair ${stair.name}`, level, at: sum, lift: 0.3 });
    });
    building.places.forEach((place, index) => {
      this.items.push({ kind: "place", index, name: place.name, level: place.level, at: place.at.map((value) => value * grain), lift: 0.3 });
    });
    for (const item of this.items) this.add(item);
    this.who = this.add({ kind: "who", name: "" });
  }

  add(item) {
    item.span = document.createElement("span");
    item.span.className = item.kind;
    item.span.textContent = item.name;
    this.node.append(item.span);
    return item;
  }

  rename(item, text) {
    if (item.text === text) return;
    item.span.textContent = item.text = text;
    item.size = null;
  }

  // Puts every label where it belongs; of two that overlap, the later one is hidden.
  update(camera, closed, selected) {
    const { clientWidth: width, clientHeight: height } = this.node, taken = [];
    const put = (item, [x, y, depth], above) => {
      const left = (x + 1) / 2 * width, top = (1 - y) / 2 * height;
      const [w, h] = item.size ??= [item.span.offsetWidth, item.span.offsetHeight];
      const box = [left - w / 2, top - (above ? h : h / 2), left + w / 2, top + (above ? 0 : h / 2)];
      const clear = depth < 1 && taken.every((other) => box[2] < other[0] || box[0] > other[2] || box[3] < other[1] || box[1] > other[3]);
      item.span.style.visibility = clear ? "visible" : "hidden";
      if (!clear) return;
      taken.push(box);
      item.span.style.transform = `translate(${box[0].toFixed(1)}px, ${box[1].toFixed(1)}px)`;
    };
    this.who.span.style.visibility = "hidden";
    if (selected) {
      this.rename(this.who, selected.name);
      put(this.who, camera.project(selected.at), true);
    }
    for (const item of this.items) {
      if (!this.layout.visible[item.level] || item.kind === "storey" && this.layout.storey >= 0) { item.span.style.visibility = "hidden"; continue; }
      const [x, y, z] = this.layout.place(item.level, ...item.at);
      if (item.kind === "exit") {
        const isClosed = closed.includes(this.record.building.portals.length + item.index);
        item.span.className = isClosed ? "closed" : "exit";
        this.rename(item, isClosed ? `${item.name} (closed)` : item.name);
      }
      const off = camera.isPlan && item.out ? 0.03 * camera.size : 0;
      put(item, camera.project([x + off * (item.out?.[0] ?? 0), y + off * (item.out?.[1] ?? 0), z + (camera.isPlan ? 0 : item.lift)]), item.kind === "exit" && !camera.isPlan);
    }
  }
}

// Direction to the right of a segment, which is outside.
function outside(x1, y1, x2, y2) {
  const length = Math.hypot(x2 - x1, y2 - y1) || 1;
  return [(y2 - y1) / length, -(x2 - x1) / length];
}

// A bar of a round length, for plans.
function updateScale(camera, height) {
  document.getElementById("scale").hidden = !camera.isPlan;
  if (!camera.isPlan) return;
  const metre = height / camera.size, power = 10 ** Math.floor(Math.log10(120 / metre));
  const length = [5, 2, 1].map((k) => k * power).find((value) => value * metre <= 130) ?? power;
  document.getElementById("scale-bar").style.width = `${length * metre}px`;
  document.getElementById("scale-text").textContent = `${length} m`;
}

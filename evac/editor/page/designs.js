// Designs: their runs with many seeds, and the page with two or more of them beside each other.

class Designs {
  constructor(act) {
    Object.assign(this, { act, all: [], chosen: new Set(), isOn: false });
    by("make-runs").addEventListener("submit", (event) => { event.preventDefault(); this.make(); });
    by("designs-box").hidden = false;
  }

  // Runs are made of the file: what is drawn is saved first.
  async make() {
    if (!this.isOn && !await this.act.save()) return;
    try {
      const order = this.isOn ? ["stop-runs", {}] : ["repeat", { name: by("design-name").value.trim(), runs: by("design-runs").valueAsNumber }];
      this.show((await ask(...order)).designs);
    } catch (error) {
      this.act.warn(error.message);
    }
  }

  show({ designs, making, failed = "" }) {
    const isNew = ({ name }) => !this.all.some((one) => one.name === name), names = designs.map(({ name }) => name);
    if (this.isOn) for (const { name } of designs.filter(isNew)) this.chosen.add(name);
    Object.assign(this, { all: designs, isOn: Boolean(making), chosen: new Set([...this.chosen].filter((name) => names.includes(name))) });
    const free = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].find((name) => !names.includes(name)) ?? "";
    if (!this.isOn && (!by("design-name").value || names.includes(by("design-name").value))) by("design-name").value = free;
    by("make-button").textContent = this.isOn ? "Stop" : "Make runs";
    by("making").textContent = making ?? failed;
    by("making").className = failed ? "error" : "";
    this.offer();
    refill(by("designs"), designs.map(({ name, runs, text }) => {
      const item = document.createElement("li"), label = document.createElement("label"), box = node("input", "", { type: "checkbox", checked: this.chosen.has(name) });
      box.addEventListener("change", () => { if (box.checked) this.chosen.add(name); else this.chosen.delete(name); this.offer(); });
      label.append(box, node("span", `${name}: ${runs}, ${text}`));
      item.append(label);
      return item;
    }));
  }

  // The page of those that are ticked, in the order of the list.
  offer() {
    const names = this.all.map(({ name }) => name).filter((name) => this.chosen.has(name));
    by("compare").hidden = names.length < 2;
    by("compare").href = `comparison/${names.join(",")}`;
    by("compare").textContent = `${names.join(" and ")} beside each other`;
  }
}

// The run of the case: started and stopped here, and shown as it goes on; its answer when it has ended.

class Running {
  constructor(view, view3d, act, canRun) {
    Object.assign(this, { view, view3d, act, canRun, state: { phase: "none" } });
    by("run").addEventListener("click", () => this.toggle());
    by("report").addEventListener("click", () => this.order("report"));
    if (!canRun) Object.assign(by("run"), { disabled: true, title: "A plan file has no people: open a case with it" });
  }

  get isOn() { return this.state.phase === "running"; }

  // The run reads the file: what is drawn is saved first.
  async toggle() {
    if (!this.canRun) return;
    if (this.isOn) return this.order("stop");
    if (await this.act.save()) await this.order("run");
  }

  async order(what) {
    try {
      this.show((await ask(what, {})).run);
    } catch (error) {
      this.act.warn(error.message);
    }
  }

  show(state) {
    const hasEnded = this.isOn && state.phase !== "running";
    const { phase, text = "", answer = [], files = [], status = "none", when, stopped, people = {} } = state, first = answer[0] ?? text;
    this.state = state;
    for (const view of [this.view, this.view3d]) {
      view.people = people;
      view.draw();
    }
    by("run").textContent = this.isOn ? "Stop" : "Run";
    by("run-text").textContent = { none: "Not run yet", running: text, failed: "The run has failed", ended: stopped ? `${capital(stopped)}. Result of ${when}:` : `Result of ${when}` }[phase];
    this.mark();
    by("run-verdict").className = phase === "failed" ? "error" : status;
    by("run-verdict").textContent = phase === "running" ? "" : first;
    by("answer").replaceChildren(...answer.slice(1).map((line) => node("li", line)));
    by("report").hidden = phase !== "ended" || files.includes("report.html");
    by("results").replaceChildren(...files.map((name) => node("a", capital(name.replace(".html", "")), { href: `result/${name}`, target: "_blank", rel: "noopener" })));
    by("run-box").dataset.phase = phase;
    if (hasEnded) by("run-box").scrollIntoView();
  }

  // A result is of what was drawn when it was made.
  mark(isChanged = this.isChanged) {
    this.isChanged = isChanged;
    const isOld = this.state.phase === "ended" && (isChanged || this.state.is_old);
    by("run-old").hidden = !isOld;
    by("run-box").classList.toggle("old", isOld);
  }
}

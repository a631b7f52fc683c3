// Puts the page together: one time, which the slider, the bird, the cursor and the list of events share.

const element = (id) => document.getElementById(id);

function load(bytes, flight) {
  const known = new Map();
  const read = (where) => {
    const key = `${where.at} ${where.step}`;
    if (!known.has(key)) known.set(key, column(bytes, where));
    return known.get(key);
  };
  for (const panel of flight.panels) {
    for (const line of panel.lines) {
      const low = read(line.low);
      line.levels = levels(read(line.time), low, line.high ? read(line.high) : low);
    }
  }
  for (const part of Object.values(flight.motion)) {
    if (!part) continue;
    part.time = read(part.time);
    for (const name of ["place", "quaternion", "tail", "flap", "twist"]) {
      if (part[name]) part[name] = part[name].map(read);
    }
  }
}

function readColors() {
  const style = getComputedStyle(document.documentElement), out = {};
  for (const name of ["ink", "dim", "line", "grid", "estimate", "setpoint", "truth", "left", "right", "cursor", "sky",
    "ground", "shadow", "flown", "ahead", "tail", "hull", "mark", "alarm"]) {
    out[name] = style.getPropertyValue(`--${name}`).trim();
  }
  out.band = Number(style.getPropertyValue("--band"));
  return out;
}

class Page {
  constructor(flight) {
    this.flight = flight;
    this.colors = readColors();
    this.time = flight.start;
    this.playing = false;
    this.scene = flight.motion.body ? new Scene(element("scene"), flight, this.colors) : null;
    this.plots = new Plots(flight, this.colors, (t) => this.go(t));
    this.head();
    this.list();
    this.listen();
    if (this.scene) this.legend(); else element("space").hidden = true;
    this.resize();
    this.go(this.flight.start);
  }

  head() {
    const { flight } = this, span = flight.end - flight.start;
    const long = spoken(span);
    const day = `${flight.date.slice(0, 10)} ${flight.date.slice(11, 16)} UTC`;
    element("vehicle").textContent = flight.vehicle;
    element("facts").textContent = [long, day, flight.file].join("  ·  ");
    const gone = flight.missing.length ? [`Not in this log: ${flight.missing.join(", ")}.`] : [];
    element("missing").textContent = [...gone, ...flight.damage.map((line) => `Damaged: ${line}.`)].join(" ");
  }

  list() {
    const { events } = this.flight;
    this.entries = events.map((event) => {
      const item = document.createElement("li"), button = document.createElement("button");
      const time = document.createElement("time"), text = document.createElement("span");
      time.textContent = clock(event.time);
      text.textContent = event.text;
      button.append(time, text);
      button.addEventListener("click", () => this.go(event.time));
      item.append(button);
      item.classList.toggle("alarm", event.severity <= 4);
      element("events").append(item);
      return item;
    });
    if (!events.length) {
      const none = document.createElement("p");
      none.textContent = "The log has none.";
      element("events").append(none);
    }
  }

  legend() {
    const { motion } = this.flight;
    const keys = [["", "flown", motion.estimated ? "true track" : "track"]];
    if (motion.estimated) keys.push(["estimated", "estimate", "estimated track"]);
    for (const [name, color, text] of keys) {
      const key = document.createElement("i");
      key.className = name;
      key.style.borderColor = `var(--${color})`;
      element("legend").append(key, text);
    }
    this.words = document.createElement("div");
    element("legend").append(this.words);
    for (const mode of ["follow", "chase", "overview"]) {
      element(mode).addEventListener("click", () => {
        this.scene.choose(mode);
        this.go(this.time);
      });
    }
  }

  listen() {
    const slider = element("slider");
    Object.assign(slider, { min: this.flight.start, max: this.flight.end, step: "any" });
    slider.addEventListener("input", () => this.go(Number(slider.value)));
    element("play").addEventListener("click", () => this.play(!this.playing));
    window.addEventListener("resize", () => this.resize());
    window.addEventListener("keydown", (event) => this.key(event));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.recolor());
  }

  key(event) {
    const typing = ["SELECT", "BUTTON", "INPUT"].includes(event.target.tagName);
    const step = event.shiftKey ? 1 : 0.1;
    if (event.key === " " && !typing) this.play(!this.playing);
    else if (event.key === "ArrowRight" && !typing) this.go(this.time + step);
    else if (event.key === "ArrowLeft" && !typing) this.go(this.time - step);
    else return;
    event.preventDefault();
  }

  play(on) {
    this.playing = on;
    element("play").textContent = on ? "❚❚" : "▶";
    element("play").setAttribute("aria-label", on ? "pause" : "play");
    if (!on) return;
    if (this.time >= this.flight.end) this.go(this.flight.start);
    this.last = null;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    if (!this.playing) return;
    const passed = this.last === null ? 0 : Math.min(0.25, (now - this.last) / 1000);
    this.last = now;
    this.go(this.time + passed * Number(element("speed").value));
    if (this.time >= this.flight.end) this.play(false);
    else requestAnimationFrame((later) => this.frame(later));
  }

  go(t) {
    const { start, end } = this.flight;
    this.time = Math.min(end, Math.max(start, t));
    element("slider").value = this.time;
    element("clock").textContent = `${clock(this.time)} / ${clock(end)}`;
    this.plots.show(this.time);
    this.point();
    if (this.scene) this.look();
  }

  look() {
    this.scene.show(this.time);
    const { place } = this.scene.pose, far = this.scene.enlarged > 1.05;
    const lines = ["east", "north", "up"].map((name, k) => `${name} ${signed(place[k].toFixed(1))} m`);
    lines[2] += this.flight.missing.includes("truth") ? " from the place of boot" : " from the ground";
    element("reading").textContent = [this.doing(), ...lines].filter(Boolean).join("\n");
    const larger = far ? `, bird drawn ${Number(this.scene.enlarged.toPrecision(2))} times its size` : "";
    this.words.textContent = `grid ${this.scene.step} m${larger}`;
    for (const mode of ["follow", "chase", "overview"]) {
      element(mode).setAttribute("aria-pressed", String(this.scene.mode === mode));
    }
  }

  // Mode and stage.
  doing() {
    const at = (bands) => bands.find(([from, to]) => this.time >= from && this.time < to)?.[2];
    return [at(this.flight.modes), at(this.flight.stages)].filter(Boolean).join(", ");
  }

  // The last event before now, kept in sight in its list.
  point() {
    const last = this.flight.events.findLastIndex((event) => event.time <= this.time + 1e-6);
    if (last === this.pointed) return;
    this.entries[this.pointed]?.classList.remove("now");
    this.pointed = last;
    const entry = this.entries[last], box = element("events");
    if (!entry) return;
    entry.classList.add("now");
    box.scrollTop = entry.offsetTop - box.offsetTop - 0.5 * box.clientHeight;
  }

  resize() {
    this.plots.draw();
    if (this.scene) this.scene.draw();
  }

  recolor() {
    Object.assign(this.colors, readColors());
    this.resize();
  }
}

// A span of time: 12.3 s, 3 min 05 s, 1 h 02 min.
function spoken(span) {
  const whole = Math.floor(span), two = (n) => String(n).padStart(2, "0");
  if (span < 60) return `${span.toFixed(1)} s`;
  if (span < 3600) return `${Math.floor(whole / 60)} min ${two(whole % 60)} s`;
  return `${Math.floor(whole / 3600)} h ${two(Math.floor(whole / 60) % 60)} min`;
}

async function main() {
  if (typeof DecompressionStream === "undefined") throw new Error("this browser is too old: it cannot decompress");
  const flight = JSON.parse(element("flight").textContent);
  load(await unpack(element("numbers").textContent), flight);
  window.page = new Page(flight);
}

main().catch((error) => {
  element("vehicle").textContent = `This flight cannot be shown: ${error.message}`;
  throw error;
});

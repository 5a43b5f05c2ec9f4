"use strict";
// Clock for all replays of a page. It controls replays by messages, since each is a separate page.
class Player {
  constructor(box, { last, period, frames, shown }) {
    Object.assign(this, { box, last, period, frames, shown, step: 0, timer: null });
    const part = name => box.querySelector(`[data-do=${name}]`);
    this.slider = box.querySelector("input[type=range]");
    this.button = part("play");
    this.speed = part("speed");
    this.slider.max = last;
    this.slider.addEventListener("input", () => this.go(Number(this.slider.value)));
    this.button.addEventListener("click", () => this.toggle());
    part("back").addEventListener("click", () => this.go(this.step - 1));
    part("on").addEventListener("click", () => this.go(this.step + 1));
    this.speed.addEventListener("change", () => { if (this.timer) { this.pause(); this.toggle(); } });
    // Meshcat starts its animation when it has loaded.
    window.addEventListener("message", event => { if (event.data?.replay === "ready") this.seek(); });
  }
  go(step) {
    this.step = Math.max(0, Math.min(this.last, step));
    this.show();
  }
  show() {
    this.slider.value = this.step;
    this.slider.setAttribute("aria-valuetext", `${(this.step * this.period).toFixed(2)} s`);
    this.shown(this.step);
    this.seek();
  }
  seek() {
    for (const frame of this.frames)
      frame.contentWindow?.postMessage({ replay: this.step * this.period }, "*");
  }
  pause() {
    cancelAnimationFrame(this.timer);
    this.timer = null;
    this.button.textContent = "play";
  }
  toggle() {
    if (this.timer) { this.pause(); return; }
    let begun = null, from = this.step;
    const speed = Number(this.speed.value);
    const tick = now => {
      begun ??= now;
      let step = from + Math.floor((now - begun) / 1000 * speed / this.period);
      if (step > this.last) { begun = now; from = 0; step = 0; }
      if (step !== this.step) this.go(step);
      this.timer = requestAnimationFrame(tick);
    };
    this.button.textContent = "pause";
    this.timer = requestAnimationFrame(tick);
  }
  // Handle keys of the page and of a focused replay.
  press(event) {
    const by = event.shiftKey ? 10 : 1, tag = event.target.tagName;
    if (tag === "SELECT" || (tag === "INPUT" && event.target.type !== "range")) return;
    if (tag === "INPUT" && event.target !== this.slider) return;
    if (event.key === "ArrowRight") this.go(this.step + by);
    else if (event.key === "ArrowLeft") this.go(this.step - by);
    else if (event.key === "Home") this.go(0);
    else if (event.key === "End") this.go(this.last);
    else if (event.key === " " && !["BUTTON", "SUMMARY"].includes(tag)) this.toggle();
    else return;
    event.preventDefault();
  }
}

function runs(values) {
  const intervals = [];
  let start = 0;
  for (let i = 1; i <= values.length; i++)
    if (i === values.length || values[i] !== values[start]) { intervals.push([start, i]); start = i; }
  return intervals;
}

// Gait strip: foot contacts over labelled and hatched RM states.
class Strip {
  static left = 26;
  static width = 610;
  static row = 22;
  constructor(svg, data, go) {
    Object.assign(this, { svg, data, last: data.state.length - 1 });
    this.draw();
    svg.addEventListener("click", event => {
      const box = svg.getBoundingClientRect();
      go(Math.round(((event.clientX - box.left) * 640 / box.width - Strip.left) / Strip.width * this.last));
    });
  }
  x(step) { return Strip.left + Strip.width * step / this.last; }
  add(name, attributes, text = "") {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    node.textContent = text;
    this.svg.append(node);
    return node;
  }
  draw() {
    const { data, last } = this, id = `hatch-${Math.random().toString(36).slice(2)}`;
    const hatch = this.add("pattern", { id, width: 7, height: 7, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
    hatch.innerHTML = '<line x1="0" y1="0" x2="0" y2="7" stroke="#555f6b" stroke-width="1.2" opacity=".55"></line>';
    let named = -Infinity;
    for (const [start, stop] of runs(data.state)) {
      const place = { x: this.x(start), width: this.x(Math.min(stop, last)) - this.x(start), y: 14, height: 84 };
      this.add("rect", { ...place, fill: data.colors[data.state[start]], opacity: .25 });
      if (data.state[start] % 2) this.add("rect", { ...place, fill: `url(#${id})` });
      const name = data.states[data.state[start]], room = 6 * name.length + 2;
      if (place.x >= named && place.width >= room) {
        this.add("text", { class: "state", x: place.x + place.width / 2, y: 10, "text-anchor": "middle" }, name);
        named = place.x + place.width / 2 + room / 2;
      }
    }
    data.legs.forEach((leg, k) => {
      const feet = data.contact.map(contact => contact[k]);
      for (const [start, stop] of runs(feet)) if (feet[start])
        this.add("rect", { x: this.x(start), width: this.x(Math.min(stop, last)) - this.x(start),
                           y: 17 + k * 20.5, height: 15, fill: "#2b2f33" });
      this.add("text", { x: 0, y: 29 + k * 20.5 }, leg);
    });
    for (let second = 0; second <= last * data.period + 1e-9; second++)
      this.add("text", { x: Math.min(this.x(second / data.period), 632), y: 112,
                         "text-anchor": this.x(second / data.period) > 630 ? "end" : "middle" }, `${second} s`);
    this.cursor = this.add("line", { y1: 12, y2: 100, stroke: "#c00000", "stroke-width": 1.8 });
  }
  show(step) {
    this.cursor.setAttribute("x1", this.x(step));
    this.cursor.setAttribute("x2", this.x(step));
  }
}

// Makes a player for replays and strips of rollouts. A shorter rollout stays at its last step.
function playTogether(box, { frames, strips: svgs, rollouts, moment, step = 0 }) {
  const strips = svgs.map((svg, k) => new Strip(svg, rollouts[k], to => player.go(to)));
  const { period } = rollouts[0];
  const player = new Player(box, {
    last: Math.max(...strips.map(strip => strip.last)), period, frames,
    shown: now => {
      for (const strip of strips) strip.show(Math.min(now, strip.last));
      moment.textContent = `${(now * period).toFixed(2)} s`;
    },
  });
  player.go(step);
  document.addEventListener("keydown", event => { if (event.target === document.body) player.press(event); });
  return player;
}

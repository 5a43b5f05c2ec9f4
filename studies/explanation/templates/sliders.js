// Coefficients that a reader changes: targets for the recorded observations, in open loop.
const edits = new Map();
const slot = (term, step) => term.weights.length > 1 ? data.state[step] : 0;
const acts = (term, step) => term.state === null || term.state === data.state[step];
const product = (term, step) => term.of.reduce((result, k) => result * data.values[step][k], 1);
const keyOf = (index, place) => `${view.joint}:${index}:${place}`;

function editedTarget(step) {
  const { target: targets, terms } = data.explained[view.joint];
  let target = targets[step];
  for (const [key, weight] of edits) {
    const [joint, index, place] = key.split(":").map(Number), term = terms[index];
    if (joint === view.joint && acts(term, step) && slot(term, step) === place)
      target += (weight - term.weights[place]) * product(term, step);
  }
  return target;
}

// Redraw rows only if the state changes, since a slider could not be dragged otherwise.
let rowsOf = null;
function showSliders() {
  const state = data.state[view.step], key = `${view.joint}:${state}`;
  if (key !== rowsOf) { rowsOf = key; drawSliders(state); }
  for (const line of at("coefficients").tBodies[0].rows)
    line.lastElementChild.textContent = signed(line.weight() * product(line.term, view.step));
  showOpenLoop();
}

function drawSliders(state) {
  at("sliders-title").textContent = `${shownJoint(view.joint)} in ${data.states[state]}`;
  const body = head(at("coefficients"), ["term"], ["coefficient"], ["", "number"], ["adds now", "number"]);
  data.explained[view.joint].terms.forEach((term, index) => {
    if (!term.weights.length || (term.state !== null && term.state !== state)) return;
    const place = term.weights.length > 1 ? state : 0, key = keyOf(index, place), original = term.weights[place];
    if (original === 0) return;
    const line = body.insertRow(), reach = 2 * Math.abs(original), name = nameOf(term);
    line.term = term;
    line.weight = () => edits.get(key) ?? original;
    line.insertCell().textContent = name;
    line.cells[0].className = "term";
    const slider = Object.assign(document.createElement("input"),
      { type: "range", min: original - reach, max: original + reach, step: "any", value: line.weight() });
    const number = Object.assign(document.createElement("input"),
      { type: "number", step: "any", value: Number(line.weight().toPrecision(4)) });
    slider.setAttribute("aria-label", `coefficient of ${name}`);
    number.setAttribute("aria-label", `coefficient of ${name}, as a number`);
    const take = value => {
      if (!Number.isFinite(value)) return;
      if (Math.abs(value - original) < 1e-9 * reach) edits.delete(key); else edits.set(key, value);
      line.classList.toggle("edited", edits.has(key));
      line.lastElementChild.textContent = signed(line.weight() * product(term, view.step));
      showOpenLoop();
    };
    slider.addEventListener("input", () => { number.value = Number(Number(slider.value).toPrecision(4)); take(Number(slider.value)); });
    number.addEventListener("change", () => { slider.value = number.value; take(Number(number.value)); });
    line.insertCell().append(slider);
    line.insertCell().append(number);
    line.insertCell().className = "number";
    line.classList.toggle("edited", edits.has(key));
  });
}

function showOpenLoop() {
  const steps = data.state.map((_, step) => step), recorded = data.explained[view.joint].target;
  const other = steps.map(editedTarget);
  let most = 0;
  for (const step of steps) if (Math.abs(other[step] - recorded[step]) > Math.abs(other[most] - recorded[most])) most = step;
  const changed = [...edits.keys()].filter(key => Number(key.split(":")[0]) === view.joint).length;
  at("reset").disabled = changed === 0;
  at("open-loop-words").textContent = changed === 0
    ? "No coefficient has been changed yet."
    : `${changed} coefficient${changed > 1 ? "s" : ""} changed. At step ${view.step} the target is ${signed(other[view.step])} instead of `
      + `${signed(recorded[view.step])} rad. The greatest difference is ${Math.abs(other[most] - recorded[most]).toFixed(3)} rad, at step ${most}.`;
  drawOpenLoop(recorded, other, changed > 0);
}

function drawOpenLoop(recorded, other, changed) {
  const chart = at("open-loop"), all = [...recorded, ...other];
  const low = Math.min(...all), high = Math.max(...all), room = Math.max(high - low, 1e-6);
  const y = value => 12 + 104 * (high - value) / room, x = step => strip.x(step);
  const line = values => values.map((value, step) => `${step ? "L" : "M"}${x(step).toFixed(1)} ${y(value).toFixed(1)}`).join("");
  const node = (name, attributes, text = "") => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    element.textContent = text;
    return element;
  };
  chart.replaceChildren(
    node("text", { x: 0, y: 10 }, `${minus(high.toFixed(2))} rad`),
    node("text", { x: 0, y: 130 }, minus(low.toFixed(2))),
    node("path", { d: line(recorded), class: "recorded" }),
    ...(changed ? [node("path", { d: line(other), class: "other" })] : []),
    node("line", { x1: x(view.step), x2: x(view.step), y1: 8, y2: 120, stroke: "#c00000", "stroke-width": 1.5 }),
  );
}

followers.push(showSliders);
at("reset").addEventListener("click", () => {
  for (const key of [...edits.keys()]) if (Number(key.split(":")[0]) === view.joint) edits.delete(key);
  rowsOf = null;
  showSliders();
});

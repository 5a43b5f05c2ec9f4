"use strict";
const certificate = data.certificate;
const MOST_INPUTS = 8, PINNED_INPUTS = 4;
let opened = null;

const element = (kind, text = "", name = "") => {
  const node = document.createElement(kind);
  node.textContent = text;
  node.className = name;
  return node;
};
const widths = x => `${minus(x.toFixed(2))} ${x === 1 ? "width" : "widths"}`;
// Of two observations the second is shown where it differs.
const both = texts => [...new Set(texts)].join(" → ");

let nearest = null;
function drawOutside() {
  at("gait").setAttribute("viewBox", "0 0 640 134");
  strip.cursor.setAttribute("y2", 130);
  strip.add("text", { x: 0, y: 129 }, "out");
  strip.add("line", { x1: strip.x(0), x2: strip.x(last), y1: 130, y2: 130, stroke: "#828b96" });
  for (const [start, stop] of runs(certificate.outside.map(own => own.length > 0)))
    if (certificate.outside[start].length)
      strip.add("rect", { class: "outside", x: strip.x(start), y: 119, height: 11, fill: "#c75300",
                          width: Math.max(1.5, strip.x(Math.min(stop, last)) - strip.x(start)) });
  nearest = strip.add("path", { id: "nearest", d: "M-6 0 h12 l-6 9 z", fill: "#c75300", visibility: "hidden" });
}

function showOutside() {
  const own = certificate.outside[view.step];
  const named = own.slice(0, 3).map(([k, by]) =>
    `${data.quantities[k]} (${by < 1e9 ? "by " + widths(by) : "which had one value alone"})`);
  const more = own.length > 3 ? ` and ${own.length - 3} more` : "";
  at("outside-now").textContent = own.length
    ? `Step ${view.step} is outside of the operating box: ${named.join(", ")}${more}.`
    : `Step ${view.step} is inside of the operating box.`;
}

function cells(table, texts, kinds) {
  const line = table.insertRow();
  texts.forEach((text, k) => { const cell = line.insertCell(); cell.textContent = text; cell.className = kinds[k]; });
  return line;
}

// Over all of the rollout, as far as the witness's inputs go.
const usual = k => {
  let low = Infinity, high = -Infinity;
  for (const values of data.values) { low = Math.min(low, values[k]); high = Math.max(high, values[k]); }
  return [low, high];
};

// The inputs of the witness: those that differ between its two observations first, then those that
// are furthest from the moment on the page.
function inputsOf(own) {
  return own.inputs.map((k, i) => {
    const here = data.values[view.step][k], values = own.values.map(all => all[i]);
    const apart = values.map(value => (value - here) / own.widths[i]);
    const furthest = apart.reduce((a, b) => Math.abs(b) > Math.abs(a) ? b : a);
    return { k, here, values, apart: furthest, usual: own.usual[i] };
  }).sort((a, b) => moves(b) - moves(a) || Math.abs(b.apart) - Math.abs(a.apart));
}

function moves(input) {
  return new Set(input.values).size > 1;
}

function inputTable(own) {
  const table = element("table", "", "inputs"), inputs = inputsOf(own);
  const body = head(table, ["input"], ["witness", "number"], [`step ${view.step}`, "number"],
                    ["this rollout", "number"], ["apart (widths)", "number"]);
  for (const { k, here, values, apart, usual: [low, high] } of inputs.slice(0, MOST_INPUTS)) {
    const strange = values.some(value => value < low || value > high);
    const line = cells(body, [data.quantities[k], both(values.map(short)), short(here),
      `${short(low)} to ${short(high)}`, minus(apart.toFixed(2))], ["name", "number", "number", "number", "number"]);
    line.cells[1].classList.toggle("beyond", strange);
  }
  const rest = inputs.length - MOST_INPUTS;
  return [table, element("p", `${rest > 0 ? `The ${MOST_INPUTS} of ${inputs.length} inputs that are moved, or differ most from step ${view.step}`
    : `All inputs, those that are moved or differ most from step ${view.step} first`}; bold is what never was so in this rollout. `
    + "A width is that of the input's range in the claim's box.")];
}

function targetTable(own) {
  const table = element("table", "", "targets");
  const body = head(table, ["target (rad)"], ["witness", "number"], [`step ${view.step}`, "number"],
                    ["joint's range", "number"]);
  data.joints.forEach((_, joint) => {
    const [low, high] = certificate.limits[joint], values = own.targets.map(all => all[joint]);
    const line = cells(body, [shownJoint(joint), both(values.map(signed)),
      signed(data.explained[joint].target[view.step]), `${minus(String(low))} to ${minus(String(high))}`],
      ["name", "number", "number", "number"]);
    line.cells[1].classList.toggle("beyond", values.some(value => value < low || value > high));
    line.classList.toggle("asked", joint === own.joint);
  });
  return [table, element("p", "What the policy answers to the witness; bold is beyond the joint's range.")];
}

function nearnessOf(own) {
  const state = data.states[own.state], here = own.distances[view.step];
  const text = element("p"), many = own.values.length > 1;
  text.append(many ? `Two observations of ${state}, the second where an arrow stands. ` : `An observation of ${state}. `,
    `${own.inputs.length} inputs decide the claim there; others count for nothing. `);
  if (own.nearest === null) {
    text.append(`This rollout is never in ${state}: none of its moments is near.`);
    return text;
  }
  const button = element("button", `step ${own.nearest}`);
  button.type = "button";
  button.addEventListener("click", () => go(own.nearest));
  text.append("The nearest moment is ", button, ` (${(own.nearest * data.period).toFixed(2)} s), `
    + `${widths(own.distances[own.nearest])} away${many ? " from the nearer one" : ""}, where two observations of the box `
    + `are up to ${own.diagonal.toFixed(2)} apart. `);
  if (view.step !== own.nearest)
    text.append(here === null ? `Step ${view.step} is in ${data.states[data.state[view.step]]}, not in ${state}.`
      : `Step ${view.step} is ${widths(here)} away.`);
  return text;
}

// Beside the replay, what is open far below.
function showPinned() {
  at("pinned").hidden = opened === null;
  if (opened === null) return;
  const own = certificate.witnesses[opened], title = element("h3", `Witness: ${own.claim}`);
  const close = element("button", "unpin");
  close.type = "button";
  close.addEventListener("click", () => open(opened, document.querySelector(`button.witness[data-claim="${opened}"]`)));
  title.append(close);
  const table = element("table"), body = head(table, ["input"], ["witness", "number"], [`step ${view.step}`, "number"]);
  for (const { k, here, values } of inputsOf(own).slice(0, PINNED_INPUTS))
    cells(body, [data.quantities[k], both(values.map(short)), short(here)], ["name", "number", "number"]);
  if (own.joint !== null)
    cells(body, [`target of ${shownJoint(own.joint)} (rad)`, both(own.targets.map(all => signed(all[own.joint]))),
      signed(data.explained[own.joint].target[view.step])], ["name", "number", "number"]).className = "sum";
  const more = element("a", "all of it");
  more.href = "#certificate";
  more.addEventListener("click", event => { event.preventDefault(); at("certificate").scrollIntoView(); });
  const last = element("p", "The inputs that are moved, or are furthest from this moment; ");
  last.append(more, ".");
  at("pinned").replaceChildren(title, table, last);
}

function showWitness() {
  showPinned();
  if (opened === null) return;
  const own = certificate.witnesses[opened], beside = element("div", "", "beside");
  const [inputs, targets] = [inputTable(own), targetTable(own)].map(parts => {
    const part = element("div");
    part.append(...parts);
    // On a narrow page it is scrolled, by keys too.
    part.tabIndex = 0;
    part.setAttribute("role", "group");
    part.setAttribute("aria-label", "Table of the witness");
    return part;
  });
  beside.append(inputs, targets);
  at("witness").firstElementChild.replaceChildren(nearnessOf(own), beside);
}

// Above the timeline, the moment that is nearest to the witness that is open.
function showNearest() {
  const step = opened === null ? null : certificate.witnesses[opened].nearest;
  nearest.setAttribute("visibility", step === null ? "hidden" : "visible");
  if (step !== null) nearest.setAttribute("transform", `translate(${strip.x(step)} 4)`);
}

function open(claim, button) {
  document.getElementById("witness")?.remove();
  for (const other of document.querySelectorAll("button.witness")) other.setAttribute("aria-expanded", false);
  opened = opened === claim ? null : claim;
  const own = certificate.witnesses[claim], line = element("tr");
  own.usual ??= own.inputs.map(usual);
  showNearest();
  showPinned();
  if (opened === null) return;
  line.id = "witness";
  line.append(element("td"));
  line.firstElementChild.colSpan = 3;
  button.closest("tr").after(line);
  button.setAttribute("aria-expanded", true);
  player.pause();
  if (own.joint !== null) view.joint = own.joint;
  if (own.nearest !== null) view.step = own.nearest;
  showAll();
  write();
}

drawOutside();
followers.push(showOutside, showWitness);
for (const button of document.querySelectorAll("button.witness"))
  button.addEventListener("click", () => open(Number(button.dataset.claim), button));
showAll();

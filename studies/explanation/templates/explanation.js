const data = JSON.parse(document.getElementById("data").textContent);
const at = id => document.getElementById(id);
const last = data.state.length - 1;
const view = { step: data.step, joint: data.joint };
// Functions that update other parts of the page at each step.
const followers = [];

const shownJoint = joint => data.joints[joint].replace("_", " ");

// A link such as #joint=FL_calf&step=40 opens the page at this joint and step.
function follow() {
  const link = new URLSearchParams(location.hash.slice(1));
  const among = (value, size) => Number.isInteger(value) && value >= 0 && value < size;
  const named = link.get("joint") || "", step = Number(link.get("step") || NaN);
  const joint = data.joints.indexOf(named.replace(" ", "_"));
  if (joint >= 0) view.joint = joint;
  else if (/^\d+$/.test(named) && among(Number(named), data.joints.length)) view.joint = Number(named);
  if (among(step, data.state.length)) view.step = step;
}
follow();
// Wait before writing, since browsers limit how often the address may change.
let writing = null;
function write() {
  clearTimeout(writing);
  writing = setTimeout(() => history.replaceState(
    null, "", `#joint=${data.joints[view.joint]}&step=${view.step}`), 250);
}

const minus = text => text.replace("-", "−");
const signed = x => (x < 0 ? "−" : "+") + Math.abs(x).toFixed(3);
const short = x => minus(String(Number(x.toPrecision(4))));

// A product of quantities, or a function of one or two.
const nameOf = term => term.of.map(k => data.quantities[k]).join(term.weights.length ? " · " : " & ") || "intercept";
const weightOf = term => term.weights[term.weights.length > 1 ? data.state[view.step] : 0];
// The factors of a term: its weight and the values at this step.
function productOf(term) {
  const values = term.of.map(k => short(data.values[view.step][k]));
  if (!term.weights.length) return "at " + values.join(", ");
  return [short(weightOf(term)), ...values].join(" × ");
}

function head(table, ...titles) {
  table.replaceChildren();
  const line = table.createTHead().insertRow();
  for (const [title, kind] of titles) {
    const cell = document.createElement(title ? "th" : "td");
    cell.textContent = title; cell.className = kind || "";
    if (title) cell.scope = "col";
    line.append(cell);
  }
  return table.createTBody();
}

function row(table, texts, low, high, scale, color, kind = "") {
  const line = table.insertRow();
  line.className = kind;
  texts.forEach((text, k) => {
    const cell = line.insertCell();
    cell.className = k === 0 ? "term" : k === texts.length - 1 ? "number" : "product";
    cell.textContent = text;
  });
  const track = line.insertCell();
  track.className = "track";
  const bar = document.createElement("i");
  const [left, right] = scale;
  const place = x => 100 * (x - left) / (right - left);
  track.style.setProperty("--zero", place(0) + "%");
  bar.style.left = place(Math.min(low, high)) + "%";
  bar.style.width = Math.abs(place(high) - place(low)) + "%";
  bar.style.background = color;
  track.append(bar);
}

function showLocal() {
  const joint = data.explained[view.joint], step = view.step;
  const values = joint.value[step], others = joint.others[step];
  at("local-title").textContent = `${shownJoint(view.joint)} at step ${step}: `
    + `target ${signed(joint.target[step])} rad`;
  const table = head(at("local"), ["term"], ["weight × values"], ["adds", "number"], [""]);
  at("which").textContent = others > 0 ? `The ${values.length} largest terms`
    : values.length === 1 ? "The only term" : `All ${values.length} terms`;
  // Each bar begins where the previous one ends, so that the last one ends at the target.
  const entries = values.map((value, k) => {
    const term = joint.terms[joint.index[step][k]];
    return [nameOf(term), productOf(term), value];
  });
  if (others > 0) entries.push([others === 1 ? "1 other term" : `${others} other terms`, "", joint.rest[step]]);
  let end = 0, low = Math.min(0, joint.target[step]), high = Math.max(0, joint.target[step]);
  for (const [, , value] of entries) {
    end += value; low = Math.min(low, end); high = Math.max(high, end);
  }
  const scale = high > low ? [low, high] : [-1, 1];
  end = 0;
  for (const [term, product, value] of entries) {
    row(table, [term, product, signed(value)], end, end + value, scale,
        value < 0 ? "var(--down)" : "var(--up)");
    end += value;
  }
  row(table, ["sum = target", "", signed(end)], 0, end, scale, "var(--total)", "sum");
  at("error").textContent = joint.error < 1e-15 ? "exactly"
    : `to within ${minus(joint.error.toExponential(0))} rad`;
}

function showValues() {
  at("observations").firstElementChild.textContent =
    `All ${data.units.length} quantities at step ${view.step}`;
  if (!at("observations").open) return;
  const table = head(at("values"), ["quantity"], ["value", "number"], ["unit"]);
  data.quantities.forEach((name, k) => {
    const line = table.insertRow();
    line.insertCell().textContent = name;
    const value = line.insertCell();
    value.className = "number"; value.textContent = short(data.values[view.step][k]);
    line.insertCell().textContent = data.units[k] ?? "function of the others";
  });
}

function drawFile() {
  if (!data.file) return;
  at("file").replaceChildren(...data.file.lines.map(text => {
    const line = document.createElement("span");
    line.textContent = text + "\n";
    return line;
  }));
}
function showFile() {
  if (!data.file) return;
  const state = data.state[view.step], [first, end] = data.file.acting[state][view.joint];
  [...at("file").children].forEach((line, k) =>
    line.classList.toggle("acting", k >= first && k < end));
  const image = data.file.mirrored[state][view.joint];
  at("image").hidden = !image;
  at("image-of").textContent = `${shownJoint(view.joint)} in ${data.states[state]}`;
  at("image-lines").textContent = image ? image.join("\n") : "";
  const file = at("file"), line = file.children[first];
  file.scrollTop = line.offsetTop - file.offsetTop - file.clientHeight / 3;
}

// The page has figures of only one joint.
function showFigures() {
  if (data.figures === null) return;
  const other = data.figures !== view.joint;
  at("figures").hidden = other;
  at("other-figures").hidden = !other;
  at("other-figures").textContent = `This page has only figures of ${shownJoint(data.figures)}; `
    + `glassgait explain page --joint ${data.joints[view.joint]} draws those of ${shownJoint(view.joint)}.`;
}

function showGlobal() {
  const joint = data.explained[view.joint];
  at("global-which").textContent = joint.moving > joint.ranked.length
    ? `The ${joint.ranked.length} of ${joint.moving} terms that swing most. ` : "";
  at("global-title").textContent = `${shownJoint(view.joint)}: terms that move it in this rollout`;
  const table = head(at("global"), ["term"], ["swing", "number"], [""]);
  const most = Math.max(...joint.importance, 1e-9);
  joint.ranked.forEach((index, k) => {
    const term = joint.terms[index];
    const weight = term.weights.length === 1 ? short(term.weights[0]) : "";
    const name = weight && !term.of.length ? weight
      : [weight, nameOf(term)].filter(Boolean).join(" · ");
    const state = term.state === null ? "" : `${data.states[term.state]}: `;
    row(table, [state + name, joint.importance[k].toFixed(3)], 0, joint.importance[k], [0, most],
        "var(--total)");
  });
}

drawFile();

const frame = at("replay");
frame.srcdoc = JSON.parse(at("replay-page").textContent);
// Dragging the replay moves the focus into its frame; pass on its keys.
frame.addEventListener("load", () => frame.contentWindow.addEventListener("keydown", event => player.press(event)));

const player = new Player(document.querySelector(".player"), {
  last, period: data.period, frames: [frame], shown: step => { view.step = step; show(); write(); },
});
const go = step => player.go(step);
const strip = new Strip(at("gait"), data, go);

function show() {
  const state = data.state[view.step];
  const chip = document.createElement("span");
  chip.className = "chip";
  chip.style.background = data.colors[state];
  chip.style.color = data.inks[state];
  chip.textContent = data.states[state];
  at("moment").replaceChildren(
    `${(view.step * data.period).toFixed(2)} s · RM state `, chip,
    `, iteration ${data.iterations[view.step]}`);
  strip.show(view.step);
  showLocal();
  showFile();
  showValues();
  followers.forEach(follower => follower());
}
data.joints.forEach((name, k) => at("joint").add(new Option(shownJoint(k), k)));
function showAll() {
  at("joint").value = view.joint;
  player.step = view.step;
  player.show();
  showGlobal();
  showFigures();
}
at("joint").addEventListener("change", event => {
  view.joint = Number(event.target.value); showAll(); write();
});
at("observations").addEventListener("toggle", showValues);
window.addEventListener("hashchange", () => { follow(); showAll(); });
document.addEventListener("keydown", event => player.press(event));

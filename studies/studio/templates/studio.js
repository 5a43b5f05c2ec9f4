"use strict";
window.studio = (() => {
  const MOST = SETUP.kept, byId = (id) => document.getElementById(id);
  const send = (kind, fields = {}) => emitEvent("studio", { kind, ...fields });
  const signed = (value, digits) => {
    const text = Math.abs(value).toFixed(digits);
    return (value < 0 && Number(text) ? "−" : "") + text;
  };
  // A slider that a person moves stays where it is, whatever comes from elsewhere meanwhile.
  const moved = new Map(), isHeld = (input) => input.matches(":active") || performance.now() - (moved.get(input) ?? -Infinity) < 400;
  const steps = [];
  let panel = null, rows = [], now = null, joint = 0, notice = null, ready = false;

  function element(tag, className, text) {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  }

  // What is dragged is one change: messages after the first say that they go on.
  function dragged(input, emit) {
    let dragging = false, last = 0, waiting = null;
    const go = () => { waiting = null; last = performance.now(); emit(parseFloat(input.value), dragging); dragging = true; };
    input.addEventListener("input", () => {
      moved.set(input, performance.now());
      if (waiting === null) waiting = setTimeout(go, Math.max(0, 60 - (performance.now() - last)));
    });
    input.addEventListener("change", () => {
      if (waiting !== null) clearTimeout(waiting);
      go();
      dragging = false;
    });
  }

  function typed(input, emit) {
    input.addEventListener("change", () => {
      const value = parseFloat(input.value);
      if (Number.isFinite(value)) emit(value); else if (now) showEdits(now.edits);
    });
  }

  /* The formula. */

  function buildPicker() {
    const states = [...new Set(SETUP.places.map((place) => place.state))];
    const names = states.length > 1 ? states : [];
    const fill = (box, values, title, key) => {
      for (const value of values) {
        const button = element("button", "", title(value));
        button.onclick = () => choose({ [key]: value });
        button.dataset.value = value;
        box.append(button);
      }
    };
    fill(byId("states"), names, (state) => SETUP.states[state], "state");
    fill(byId("legs"), SETUP.legs.filter((leg) => SETUP.places.some((place) => place.leg === leg)), (leg) => leg, "leg");
    fill(byId("parts"), [...new Set(SETUP.places.map((place) => place.part))], (part) => part, "part");
  }

  function choose(change) {
    const wanted = { ...SETUP.places[panel.place], ...change };
    const same = (place) => Object.keys(wanted).filter((key) => place[key] === wanted[key]).length;
    const held = SETUP.places.filter((place) => Object.keys(change).every((key) => place[key] === change[key]));
    const best = held.sort((a, b) => same(b) - same(a))[0];
    send("choose", { place: SETUP.places.indexOf(best) });
  }

  function buildTerms() {
    const box = byId("terms");
    box.replaceChildren();
    rows = [];
    for (const group of panel.groups) {
      const head = element("div", "group", group.name);
      head.append(element("span", "", ""));
      box.append(head);
      for (const term of group.terms) rows[term.index] = { ...buildTerm(box, term), head };
    }
    const place = SETUP.places[panel.place];
    const shown = { states: place.state, legs: place.leg, parts: place.part };
    for (const id in shown) for (const button of byId(id).children)
      button.setAttribute("aria-pressed", button.dataset.value === String(shown[id]));
    byId("joint-title").textContent = panel.title;
    byId("acting").replaceChildren(...panel.acting.map((own) => {
      const part = element("span", "", `${SETUP.states[own.state]}: ${own.joint}${own.mirrored ? ", in the mirror" : ""}`);
      part.dataset.state = own.state;
      return part;
    }));
    byId("acting").title = "The joint that the formula acts on in each state; in the mirror, names and signs are those of the file";
    steps.length = 0;
  }

  function buildTerm(box, term) {
    const row = element("div", "row"), words = term.factors.join(" · ") || "constant";
    const on = element("input"), number = element("input"), slider = element("input");
    const of = element("div", "of"), bars = element("div", "bars"), bar = element("i"), adds = element("span", "adds");
    on.type = "checkbox"; on.title = "Switch this term off or on"; on.setAttribute("aria-label", `${words}: on`);
    number.type = "number"; number.step = "any"; number.setAttribute("aria-label", `Coefficient of ${words}`);
    slider.type = "range"; slider.step = "any"; slider.setAttribute("aria-label", `Coefficient of ${words}`);
    const reach = 2 * (Math.abs(term.start) || 0.05);
    slider.min = term.start - reach; slider.max = term.start + reach;
    if (term.number === null) for (const input of [on, number, slider]) { input.disabled = true; input.title = "shares its numbers with other terms"; }
    const name = element("var"); name.title = words;
    name.textContent = words;
    of.append(name, element("small"));
    bars.append(bar);
    row.append(on, number, slider, of, bars, adds);
    row.dataset.term = term.index; row.dataset.factors = term.factors.join("*");
    box.append(row);
    on.onchange = () => send("switch", { term: term.index, on: on.checked });
    typed(number, (value) => send("coefficient", { term: term.index, value }));
    dragged(slider, (value, goes_on) => {
      const short = parseFloat(value.toPrecision(3));
      number.value = short;
      send("coefficient", { term: term.index, value: short, goes_on });
    });
    return { row, on, number, slider, bar, adds, small: of.lastChild, symbols: term.symbols };
  }

  function showFormula(formula) {
    byId("text").textContent = formula.lines.join("\n");
  }

  function showEdits(edits) {
    if (!edits) return;
    byId("undo").disabled = !edits.undo;
    byId("redo").disabled = !edits.redo;
    byId("reset").disabled = edits.count === 0;
    byId("changed").textContent = edits.count ? `${edits.count} number${edits.count > 1 ? "s" : ""} changed` : "";
    rows.forEach((own, index) => {
      const value = edits.coefficients[index];
      if (!isHeld(own.slider)) own.slider.value = value;
      own.number.value = value;
      own.on.checked = !edits.off[index];
      own.row.classList.toggle("off", edits.off[index]);
      own.number.classList.toggle("edited", edits.changed[index]);
    });
    for (const input of document.querySelectorAll("#definitions input")) {
      input.value = edits.numbers[input.dataset.index];
      input.classList.toggle("edited", edits.changed_numbers.includes(Number(input.dataset.index)));
    }
    markPlaces(edits.changed_places.map((index) => SETUP.places[index]));
  }

  function markPlaces(edited) {
    const of = SETUP.places[panel.place];
    for (const [id, key] of [["legs", "leg"], ["parts", "part"]]) for (const button of byId(id).children)
      button.classList.toggle("edited", edited.some((place) => place[key] === button.dataset.value && (key === "leg" || place.leg === of.leg)));
  }

  function buildDefinitions() {
    for (const own of SETUP.definitions) {
      const box = element("div", "definition"), code = element("code");
      const symbol = element("b", "", own.symbol);
      code.append(symbol, " = ");
      own.text.split(/⟦(\d+)⟧/).forEach((part, i) => {
        if (i % 2 === 0) { code.append(part); return; }
        const input = element("input");
        input.type = "number"; input.step = "any"; input.dataset.index = part;
        input.setAttribute("aria-label", `Number of ${own.symbol}`);
        typed(input, (value) => send("number", { index: Number(part), value }));
        code.append(input);
      });
      const note = element("small", "muted");
      note.append(own.note);
      box.append(code, note);
      byId("definitions").append(box);
    }
  }

  function showTerms(frame) {
    const live = frame.terms;
    if (!panel || !live || live.values.length !== rows.length) return;
    const most = Math.max(0.05, ...live.values.map(Math.abs)), sums = new Map();
    rows.forEach((own, index) => {
      const value = live.values[index];
      own.bar.style.transform = `scaleX(${(value / most).toFixed(3)})`;
      own.bar.className = value < 0 ? "minus" : "";
      own.adds.textContent = signed(value, 3);
      own.small.textContent = own.symbols.map((name) => signed(live.symbols[panel.symbols.indexOf(name)], 2)).join(" · ");
      sums.set(own.head, (sums.get(own.head) || 0) + value);
    });
    for (const [head, sum] of sums) head.lastChild.textContent = `${signed(sum, 3)} rad`;
    byId("asked").innerHTML = `asks for <b>${signed(live.asked, 3)}</b> rad`;
    for (const part of byId("acting").children) part.classList.toggle("now", part.dataset.state === String(frame.state));
  }

  /* What is below. */

  function canvasOf(id) {
    const canvas = byId(id), scale = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale); canvas.height = Math.round(height * scale);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "11.5px system-ui, sans-serif";
    return { pen, width, height };
  }

  function drawGait() {
    const { pen, width, height } = canvasOf("gait"), left = 26, lane = (height - 16) / 4;
    const x = (index) => left + ((index + MOST - steps.length) / MOST) * (width - left);
    drawSeconds(pen, left, width, height);
    SETUP.legs.forEach((leg, row) => {
      pen.fillStyle = "#566170";
      pen.textBaseline = "middle";
      pen.fillText(leg, 0, (row + 0.5) * lane);
      pen.fillStyle = "#eef1f4";
      pen.fillRect(left, row * lane + 3, width - left, lane - 6);
      for (let start = 0; start < steps.length; ) {
        let end = start + 1;
        while (end < steps.length && steps[end][0] === steps[start][0] && steps[end][1 + row] === steps[start][1 + row]) end += 1;
        if (steps[start][1 + row]) {
          pen.fillStyle = SETUP.colors[steps[start][0]];
          pen.fillRect(x(start), row * lane + 3, x(end) - x(start), lane - 6);
        }
        start = end;
      }
    });
  }

  function drawSeconds(pen, left, width, height) {
    pen.strokeStyle = "#e3e7ec"; pen.fillStyle = "#566170"; pen.textBaseline = "bottom"; pen.lineWidth = 1;
    const seconds = MOST * SETUP.period;
    for (let second = 0; second <= seconds; second += 2) {
      const at = left + (second / seconds) * (width - left), text = second === seconds ? "now" : `−${seconds - second} s`;
      pen.beginPath(); pen.moveTo(at + 0.5, 0); pen.lineTo(at + 0.5, height - 15); pen.stroke();
      const w = pen.measureText(text).width;
      pen.fillText(text, Math.min(Math.max(at - w / 2, left), width - w), height);
    }
  }

  function drawAngles() {
    const { pen, width, height } = canvasOf("angles"), left = 40, base = height - 16;
    if (!steps.length) return;
    const every = steps.flatMap((step) => step.slice(5));
    let low = Math.min(...every), high = Math.max(...every);
    const middle = (low + high) / 2, half = Math.max((high - low) / 2, 0.05) * 1.08;
    low = middle - half; high = middle + half;
    drawSeconds(pen, left, width, height);
    const y = (value) => 3 + (base - 6) * (1 - (value - low) / (high - low));
    pen.fillStyle = "#566170"; pen.textBaseline = "top"; pen.fillText(signed(high, 2), 0, 0);
    pen.textBaseline = "bottom"; pen.fillText(signed(low, 2), 0, base);
    for (const [index, color, thick] of [[7, "#8A94A3", 1.2], [5, "#1B2430", 1], [6, "#0072B2", 1.8]]) {
      pen.strokeStyle = color; pen.lineWidth = thick; pen.beginPath();
      steps.forEach((step, i) => {
        if (step[index] === undefined) return;
        pen.lineTo(left + ((i + MOST - steps.length) / MOST) * (width - left), y(step[index]));
      });
      pen.stroke();
    }
  }

  function showTiles(frame) {
    if (!frame.robot) return;
    const ghost = frame.ghost, of = (id, text) => { byId(id).textContent = text; };
    of("reward", signed(frame.robot.reward, 1)); of("ghost-reward", ghost ? `ghost ${signed(ghost.reward, 1)}` : "");
    of("rhythm", signed(frame.robot.rhythm, 2)); of("ghost-rhythm", ghost ? `ghost ${signed(ghost.rhythm, 2)}` : "");
    of("went", signed(frame.robot.speed, 2)); of("ghost-went", ghost ? `ghost ${signed(ghost.speed, 2)}` : "");
    of("fallen", frame.count.falls); of("ghost-fallen", ghost ? `ghost ${frame.count.ghost_falls}` : "");
    const share = frame.count.steps ? (100 * frame.count.late) / frame.count.steps : 0;
    of("late", `${frame.count.late} of ${frame.count.steps} (${share.toFixed(1)} %)`);
  }

  /* What a person asked for. */

  function showStatus(status) {
    now = status;
    byId("pause").textContent = status.paused ? "Go on" : "Pause";
    byId("step").disabled = !status.paused;
    byId("ghost").checked = status.ghost;
    const shown = { speed: [status.steering.speed, (v) => `${signed(v, 2)} m/s`], yaw_rate: [status.steering.yaw_rate, (v) => `${signed(v, 2)} rad/s`],
      dwell: [status.steering.dwell, (v) => `${v} steps`], slope: [status.slope, (v) => `${signed(v, 0)}°`], latency: [status.latency, (v) => `${(1000 * v).toFixed(0)} ms`] };
    for (const id in shown) {
      const input = byId(id), [value, words] = shown[id], held = isHeld(input);
      if (!held) input.value = value;
      const text = words(held ? parseFloat(input.value) : value);
      input.parentElement.querySelector("output").textContent = text;
      input.setAttribute("aria-valuetext", text);
    }
    if (status.edits && panel) showEdits(status.edits);
    if (status.verification) showVerification(status.verification);
    if (status.evaluation) showEvaluation(status.evaluation);
    if (status.problem !== notice) {
      notice = status.problem;
      byId("notice").textContent = notice || "";
      byId("notice").hidden = !notice;
      if (notice) setTimeout((own) => { if (own === notice) byId("notice").hidden = true; }, 7000, notice);
    }
  }

  function showFile(file) {
    const chip = byId("certificate"), own = SETUP.certificate;
    chip.className = `chip ${own ? (file.holds ? "holds" : "void") : ""}`;
    if (!own) chip.textContent = "no certificate ships of this file";
    else if (file.holds) chip.textContent = `✓ certificate holds: ${own.counts.proved} of ${own.total} claims proved`;
    else chip.textContent = `✗ certificate void: of ${file.certificate.slice(0, 8)}…, this file is ${file.digest.slice(0, 8)}…`;
    chip.title = chip.textContent;
    byId("digests").textContent = file.changed
      ? `SHA-256 ${file.digest}…${own ? `; the certificate is of ${file.certificate}…` : ""}` : "Nothing is changed.";
    const box = byId("diff");
    box.replaceChildren(...file.diff.map((line) => element("span", { "+": "plus", "-": "minus", "@": "at" }[line[0]] || "", line)));
    const lines = file.diff.filter((line) => line[0] === "+").length;
    badge("diff", lines);
    for (const [id, fresh] of [["verify-state", file.verified], ["evaluate-state", file.evaluated]]) byId(id).dataset.fresh = fresh;
    if (now) { if (now.verification) showVerification(now.verification); if (now.evaluation) showEvaluation(now.evaluation); }
  }

  function badge(tab, count) {
    const button = document.querySelector(`[data-tab="${tab}"]`);
    button.querySelector(".badge")?.remove();
    if (count) button.append(element("span", "badge", count));
  }

  const staleWords = (id) => (byId(id).dataset.fresh === "false" ? " The file has changed since." : "");

  function showVerification(own) {
    const bar = byId("verify-progress");
    bar.hidden = !own.runs; bar.max = own.total || 23; bar.value = own.number;
    const rest = own.compared ? `${own.lost} lost against the original.` : "The original is proved as well, to compare.";
    byId("verify-state").textContent = own.problem || (own.runs ? `${own.number} of ${own.total || "…"} claims decided; ${rest}` : `${own.number} claims decided; ${rest}`) + staleWords("verify-state");
    badge("verify", own.lost);
    const marks = { proved: "✓", refuted: "✗", undecided: "○" };
    byId("claims").replaceChildren(...own.rows.map((row) => {
      const box = element("div", `claim ${row.outcome} ${row.lost ? "lost" : ""}`), words = element("div", "", row.name);
      box.append(element("b", "", row.lost ? "✗ lost" : `${marks[row.outcome]} ${row.word}`), words);
      const tail = row.lost ? `was proved, is ${row.word} now; ${row.where}` : row.where;
      words.append(element("small", "", tail));
      return box;
    }));
  }

  function showEvaluation(own) {
    const bar = byId("evaluate-progress");
    bar.hidden = !own.runs; bar.max = own.total || 1;
    if (own.number) bar.value = own.number; else bar.removeAttribute("value");
    byId("evaluate-state").textContent = own.problem || `${own.number}${own.total ? ` of ${own.total}` : ""} counts done.${staleWords("evaluate-state")}`;
    const table = byId("falls"), head = element("tr");
    for (const text of ["scenario", "edited", "original"]) { const cell = element("th", "", text); cell.scope = "col"; head.append(cell); }
    const cell = (falls, robots) => (falls === undefined ? "…" : `${falls} of ${robots}`);
    table.replaceChildren(head, ...own.rows.map((row) => {
      const line = element("tr");
      line.append(element("td", "", row.title), element("td", row.original !== undefined && row.edited > row.original ? "more" : "", cell(row.edited, row.robots)), element("td", "", cell(row.original, row.robots)));
      return line;
    }));
  }

  /* Controls. */

  function connect() {
    const act = (id, what) => { const button = byId(id); if (button) button.onclick = () => send("act", { what: typeof what === "function" ? what() : what }); };
    act("pause", () => (now && now.paused ? "go" : "pause"));
    for (const id of ["step", "restart", "undo", "redo", "reset", "save", "verify"]) act(id, id);
    for (const button of document.querySelectorAll(".halt")) button.onclick = () => send("act", { what: "halt work" });
    const value = (id) => parseFloat(byId(id).value);
    const steer = () => send("steer", { speed: value("speed"), yaw_rate: value("yaw_rate"), dwell: value("dwell") });
    for (const id of ["speed", "yaw_rate", "dwell"]) dragged(byId(id), steer);
    watchGamepad(SETUP.dead_zone, (axes) => send("gamepad", { axes }), (words) => { byId("gamepad").textContent = words; });
    for (const id of ["slope", "latency"]) byId(id).addEventListener("change", () => send("surroundings", { slope: value("slope"), latency: value("latency") }));
    for (const id of ["slope", "latency"]) byId(id).addEventListener("input", () => { moved.set(byId(id), performance.now()); if (now) showStatus(now); });
    const size = () => { byId("push").parentElement.querySelector("output").textContent = `${value("push").toFixed(1)} m/s`; };
    byId("push").oninput = size; size();
    for (const button of document.querySelectorAll(".pad button")) button.onclick = () => send("push", { angle: Number(button.dataset.angle), speed: value("push") });
    byId("ghost").onchange = () => send("ghost", { walks: byId("ghost").checked });
    for (const own of SETUP.scenarios) {
      const label = element("label"), tick = element("input");
      tick.type = "checkbox"; tick.checked = own.ticked; tick.value = own.name;
      label.append(tick, own.title);
      byId("scenarios").append(label);
    }
    byId("evaluate").onclick = () => send("evaluate", { scenarios: [...document.querySelectorAll("#scenarios input:checked")].map((tick) => tick.value) });
    for (const button of document.querySelectorAll("nav button")) button.onclick = () => {
      for (const other of document.querySelectorAll("nav button")) {
        other.setAttribute("aria-selected", other === button);
        byId(`tab-${other.dataset.tab}`).hidden = other !== button;
      }
      history.replaceState(null, "", `#${button.dataset.tab}`);
    };
    // Where the connection was lost the page is loaded anew, at the tab that was open.
    document.querySelector(`nav [data-tab="${location.hash.slice(1)}"]`)?.click();
    if (byId("joint")) byId("joint").onchange = () => { joint = Number(byId("joint").value); steps.length = 0; send("joint", { joint }); };
    document.addEventListener("keydown", (event) => {
      if (event.key === " " && event.target === document.body) { event.preventDefault(); byId("pause").click(); }
      if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && SETUP.formulas) {
        event.preventDefault();
        send("act", { what: event.shiftKey ? "redo" : "undo" });
      }
    });
    const legend = byId("state-legend");
    SETUP.states.forEach((state, i) => { const mark = element("i"); mark.style.background = SETUP.colors[i]; legend.append(mark, state); });
    if (SETUP.formulas) { buildPicker(); buildDefinitions(); } else byId("joint-title").textContent = SETUP.joints[0];
  }

  function take(message) {
    if (!ready) { if (!byId("gait")) return; ready = true; connect(); }
    if (message.panel) { panel = message.panel; buildTerms(); }
    if (message.formula) showFormula(message.formula);
    if (message.status) showStatus(message.status);
    if (message.file) showFile(message.file);
    const frame = message.frame;
    if (frame.first) steps.length = 0;
    steps.push(...(frame.steps || []));
    steps.splice(0, Math.max(0, steps.length - MOST));
    if (!SETUP.formulas) byId("joint-title").textContent = SETUP.joints[joint];
    showTerms(frame);
    showTiles(frame);
    drawGait();
    drawAngles();
    document.body.dataset.moment = frame.number;
  }

  return { take, steps };
})();

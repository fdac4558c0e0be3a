"use strict";
// The page of the workbench. It holds no rules: it shows the state that the server gives, and sends orders.
const $ = id => document.getElementById(id);
let state = null, busy = false, sorted = null;
// The rows of each task and chain by their names: to make all of them takes longer than to schedule the tasks.
const made = new Map();

const viewer = new Viewer($("chart"), {
  chosen(job) { $("facts").textContent = job ? viewer.describe(job) : viewer.heat ? "how much the WCET can grow: from orange, 0 %, to blue, 100 % and more" : lowerRow(); },
  moved(job, start, lane) { // a start that stays is sent as it was read: thirds of a millisecond have no decimals
    const when = start === job.start ? job.startText : `${+start.toFixed(6)}ms`, unit = lane < 0 ? {} : {unit: state.units[lane]};
    order("pin", {mode: viewer.mode.name, task: job.name, index: job.index, start: when, ...unit});
  },
});

function lowerRow() { return viewer.mode && viewer.mode.strip ? `lower rows: ${state.beside.name}. ${viewer.mode.strip.caption}` : ""; }

// Orders go to the server one after the other: what is typed while it works is not lost.
let before = Promise.resolve();

function order(...words) {
  before = before.then(() => send(...words));
  return before;
}

async function send(name, stated = {}, quiet = false) {
  busy = true; document.body.setAttribute("aria-busy", "true");
  const watch = setTimeout(follow, 400);
  try {
    const answer = await fetch(`/api/${name}`, {method: "POST", headers: {"Content-Type": "application/json"},
      body: JSON.stringify({revision: state ? state.revision : 0, ...stated})});
    if (!answer.ok && answer.status !== 409) throw new Error(await answer.text());
    const told = await answer.json();
    show(told, quiet);
    return told.solved || told.refused ? told : await send("settle", {}, quiet); // drawn first, then solved
  } catch (failure) {
    say(`${failure.message || failure}: is the server still there?`, "bad");
    return null;
  } finally {
    clearTimeout(watch); busy = false; document.body.removeAttribute("aria-busy"); $("cancel").hidden = true;
  }
}

async function follow() {
  if (!busy) return;
  $("cancel").hidden = false;
  try {
    const told = await (await fetch("/api/progress")).json();
    if (busy) say(told.mode ? `searching mode ${told.mode}: ${told.made} of ${told.allowed} moves` : "working…", "");
  } catch { /* the order itself will tell */ }
  setTimeout(follow, 400);
}

function say(text, kind) { $("verdict").textContent = $("verdict").title = text; $("verdict").className = kind; }

function element(name, text, properties = {}) {
  const made = document.createElement(name);
  if (text) made.textContent = text;
  return Object.assign(made, properties);
}

function show(told, quiet) {
  state = told;
  document.title = `${told.model} – halpipe`;
  $("title").textContent = `${told.model}`;
  options($("mode"), [...told.modes, ...told.switches].map(table => table.name), $("mode").value);
  options($("chain"), told.chains.map(chain => chain.name), $("chain").value, "no chain");
  options($("export"), told.formats, "", "export…");
  options($("variants"), told.variants, $("variants").value, "variants…");
  viewer.pinned = new Set(told.pins.map(([mode, task, index]) => `${mode} ${told.tasks.findIndex(t => t.name === task)} ${index}`));
  const chain = told.chains.find(each => each.name === $("chain").value);
  viewer.chain = chain ? chain.tasks : null;
  draw();
  $("undo").disabled = !told.can_undo; $("redo").disabled = !told.can_redo; $("unpin").disabled = !told.pins.length;
  const answered = told.answered;
  const stayed = answered.jobs ? `; ${answered.stayed} of ${answered.jobs} jobs stay` : "";
  if (told.refused) say(told.refused[0].message, "bad");
  else if (!told.solved) say(`solving: ${told.what}`, "");
  else if (told.valid) say(answered.milliseconds === null ? `valid, verified before: ${told.what}` : `valid, verified in ${answered.milliseconds} ms${stayed}`, "good");
  else say(`no schedule of this model${told.modes.length ? ": the last valid one is shown" : ""}`, "bad");
  findings([...(told.refused || []), ...told.findings]);
  if (told.unkept) findings([{severity: "warning", message: `edits are in memory only: ${told.unkept}`, help: "save under another name before you stop the server"}], true);
  if (told.restored) findings([{severity: "warning", message: "edits of an earlier session are restored", help: "save them, or undo them to see the model as its file has it"}], true);
  if (told.changed_on_disk) findings([{severity: "warning", message: "the model file was changed by another program", help: "save under another name, or open it again"}], true);
  if (told.beside) findings(told.beside.found.map(message => ({severity: "note", message, path: "", help: "", code: ""})), true);
  if (!viewer.selected) viewer.select(null);
  tools();
  if (!quiet) { tables(); }
}

// Shows the mode that is chosen, as high as its lanes need.
function draw() {
  viewer.show(state, $("mode").value);
  const height = `${Math.max(380, Math.min(20000, viewer.tall()))}px`;
  if (viewer.canvas.style.height !== height) viewer.canvas.style.height = height;
}

function options(select, names, chosen, first) {
  const values = [...(first ? [""] : []), ...names];
  if (select.options.length === values.length && values.every((value, place) => select.options[place].value === value)) return;
  select.replaceChildren(...(first ? [element("option", first, {value: ""})] : []), ...names.map(name => element("option", name, {value: name})));
  if (names.includes(chosen)) select.value = chosen;
}

function tools() {
  $("take").disabled = !$("variants").value;
  $("beside").disabled = !$("variants").value && !(state.beside && state.beside.kind === "variant");
  const lower = state.beside ? state.beside.kind : "";
  for (const [id, kind] of [["beside", "variant"], ["trace", "trace"]]) $(id).setAttribute("aria-pressed", String(lower === kind));
  $("margins").setAttribute("aria-pressed", String(Boolean(viewer.heat)));
}

// Notes are folded where there is something graver to read.
function findings(found, more = false) {
  const row = each => {
    const made = element("li", `${each.path ? each.path + ": " : ""}${each.message}`, {className: each.severity});
    made.append(element("small", [each.help, each.code].filter(Boolean).join(" · ")));
    return made;
  };
  const notes = found.filter(each => each.severity === "note"), rows = found.filter(each => each.severity !== "note").map(row);
  if (rows.length && notes.length) {
    const folded = element("details"), list = element("ul");
    list.append(...notes.map(row));
    folded.append(element("summary", `${notes.length} note${notes.length === 1 ? "" : "s"}`), list);
    const item = element("li", "", {className: "note"});
    item.append(folded);
    rows.push(item);
  } else rows.push(...notes.map(row));
  if (more) $("findings").append(...rows); else $("findings").replaceChildren(...rows);
}

function field(edit, wide) {
  const input = element("input", "", {className: wide ? "wide" : "", told: ""});
  input.setAttribute("aria-label", [edit.name, edit.inner, edit.after, edit.field].filter(Boolean).join(" "));
  input.addEventListener("change", async () => {
    input.told = input.value;
    const told = await order("edit", {...edit, value: input.value}, true);
    for (const known of made.values()) if (known.fields.has(input)) known.content = ""; // what was typed is no content of the model
    const isOutdated = told && told.refused && told.refused[0].code === "HAL0952"; // the new state is shown, in the tables, too
    if (told && told.refused && !isOutdated) { input.classList.add("wrong"); input.title = told.refused[0].message; }
    else { tables(); }
  });
  input.addEventListener("keydown", event => { if (event.key === "Escape") { input.told = input.value; tell(input, input.actual); } });
  return input;
}

// Shows a value in its field, but never over text being typed there.
function tell(input, value) {
  input.actual = value;
  if (input === document.activeElement && input.value !== input.told) return;
  input.told = input.value = value;
  input.classList.remove("wrong"); input.removeAttribute("title");
}

function cell(row, ...inside) { const made = element("td"); made.append(...inside); row.append(made); return made; }

function figures(task) { return task.figures[state.modes.indexOf(viewer.mode)] || {}; }

function taskTable() {
  const needle = $("search").value.toLowerCase(), rows = [];
  const wanted = state.tasks.filter(task => task.name.toLowerCase().includes(needle) || !needle);
  if (sorted) wanted.sort((a, b) => compare(sorted.key, a, b) * sorted.sign);
  for (const task of wanted) rows.push(...rowsOf(task));
  fill($("tasks").tBodies[0], rows);
}

// Puts rows into the body of a table, and leaves alone those that are at their place: the browser lays out the others.
function fill(body, rows) {
  const kept = new Set(rows);
  for (const row of [...body.children]) if (!kept.has(row)) row.remove();
  rows.forEach((row, place) => { if (body.children[place] !== row) body.insertBefore(row, body.children[place] || null); });
}

function rowsOf(task) {
  const own = figures(task), {versions, colour, period, deadline} = task;
  const content = [versions, period, deadline, own.response, own.margin, own.jitter, own.gaps];
  return kept(`task ${task.name}`, [colour, versions.map(version => version.name)], content, task, taskRows);
}

// Rows stay as long as their form is the same, so that the keyboard stays where it is; their content is updated.
function kept(name, form, content, shown, make) {
  const shape = JSON.stringify(form), text = JSON.stringify(content);
  let known = made.get(name);
  if (!known || known.shape !== shape) {
    const fields = new Map(), texts = [];
    known = {shape, content: "", fields, texts, rows: make(shown, fields, texts)};
    made.set(name, known);
  }
  if (known.content !== text) {
    known.content = text;
    for (const [input, read] of known.fields) tell(input, read(shown));
    for (const [place, read] of known.texts) place.title = place.textContent = String(read(shown) ?? "");
  }
  return known.rows;
}

function taskRows(task, fields, texts) {
  const {name, colour} = task;
  const put = (row, edit, read, wide) => { const input = field(edit, wide); cell(row, input); fields.set(input, read); };
  return task.versions.map((version, place) => {
    const row = element("tr"), first = cell(row), inner = version.name;
    if (!place) {
      const swatch = element("span", "", {className: "swatch"}); swatch.style.setProperty("background", colour);
      first.append(swatch, name); first.title = name;
    }
    cell(row, inner).title = inner;
    if (place) cell(row); else put(row, {kind: "task", name, field: "period"}, now => now.period);
    put(row, {kind: "version", name, inner, field: "wcet"}, now => now.versions[place].wcet);
    put(row, {kind: "version", name, inner, field: "units"}, now => now.versions[place].units, true);
    if (place) cell(row); else put(row, {kind: "task", name, field: "deadline"}, now => now.deadline);
    for (const key of ["response", "margin", "jitter", "gaps"]) { const here = cell(row); if (!place) texts.push([here, now => figures(now)[key]]); }
    return row;
  });
}

function compare(key, a, b) {
  const value = task => key in task ? task[key] : key === "wcet" ? task.versions[0].wcet : figures(task)[key] ?? "";
  const [left, right] = [value(a), value(b)], [x, y] = [parseFloat(left), parseFloat(right)];
  return Number.isNaN(x) || Number.isNaN(y) ? String(left).localeCompare(String(right)) : x - y;
}

function tables() {
  taskTable();
  for (const table of ["chains", "windows", "modes"]) {
    const own = state.forms.filter(form => form.table === table), mode = viewer.mode ? viewer.mode.name : "";
    fill($(table).tBodies[0], own.flatMap(form => kept(JSON.stringify(form.edit), form.cells.map(cell => cell.field), [form.cells, mode], form, formRows)));
    $(table).hidden = !own.length;
  }
}

// The row of a chain, a window, an access or a mode: fields, and texts, some of which differ by mode.
function formRows({edit, cells}, fields, texts) {
  const row = element("tr");
  cells.forEach(({field: name, wide}, place) => {
    if (!name) { texts.push([cell(row), ({cells: now}) => now[place].text ?? (viewer.mode && now[place].by_mode[viewer.mode.name])]); return; }
    const input = field({...edit, field: name}, wide);
    cell(row, input); fields.set(input, now => now.cells[place].value);
  });
  return [row];
}

$("mode").addEventListener("change", () => { draw(); tables(); });
$("chain").addEventListener("change", () => show(state, true));
$("search").addEventListener("input", () => { viewer.filter = $("search").value.toLowerCase(); viewer.draw(); taskTable(); });
$("undo").addEventListener("click", () => order("undo"));
$("redo").addEventListener("click", () => order("redo"));
$("unpin").addEventListener("click", () => order("unpin"));
$("cancel").addEventListener("click", () => fetch("/api/cancel", {method: "POST", headers: {"Content-Type": "application/json"}, body: "{}"}));
$("why").addEventListener("click", async () => {
  const told = await order("explain", {mode: viewer.mode ? viewer.mode.name : ""}, true);
  if (told && told.said) findings(told.said);
});
$("margins").addEventListener("click", async () => {
  if (viewer.heat) { heat(null); return; }
  const told = await order("sensitivity", {}, true);
  if (told && told.said) heat(told.said);
});
function heat(margins) { viewer.heat = margins; viewer.select(viewer.selected); tools(); }
$("save").addEventListener("click", async () => {
  const path = prompt("Save the model (.xml), or what was changed as an overlay (.yaml), as", state.path);
  if (path === null) return;
  let told = await order("save", {path}, true);
  const there = told && told.refused && told.refused[0].code === "HAL0953";
  if (there && confirm(`${told.refused[0].message}. Overwrite it?`)) told = await order("save", {path, force: true}, true);
  if (told && told.said) say(told.said, "good");
});
const ADDED = {task: "name, period and WCET", unit: "name and type", chain: "name and tasks"};
options($("change"), ["add", "remove"].flatMap(kind => Object.keys(ADDED).map(field => `${kind} ${field}`)), "", "add, remove…");
$("change").addEventListener("change", event => {
  const [kind, field] = event.target.value.split(" "); event.target.value = "";
  const [name, ...value] = (prompt(`${kind} ${field}: ${kind === "add" ? ADDED[field] : "name"}`) || "").split(/[\s,]+/).filter(Boolean);
  if (name) order("edit", {kind, name, field, value: value.join(" ")});
});
$("keep").addEventListener("click", () => { const name = prompt("Name of the variant"); if (name) order("keep", {name}); });
$("variants").addEventListener("change", tools);
$("take").addEventListener("click", () => order("take", {name: $("variants").value}));
// A second press on a button draws nothing under the schedule again.
function drawUnder(kind, choose) {
  const stated = state.beside && state.beside.kind === kind ? {kind: "nothing", name: ""} : {kind, name: choose()};
  if (stated.name !== null) order("beside", stated);
}
$("beside").addEventListener("click", () => drawUnder("variant", () => $("variants").value));
$("trace").addEventListener("click", () => drawUnder("trace", () => prompt("File of a recorded run to draw under the schedule")));
$("export").addEventListener("change", async event => {
  const format = event.target.value; event.target.value = "";
  if (!format) return;
  const options = {revision: state.revision};
  if (format === "regulator" && !(options.platform = prompt("Platform file of the regulators (YAML)"))) return;
  if (["timpani", "feo"].includes(format)) options.mode = viewer.mode.name; // these hold one mode
  const answer = await fetch(`/api/export/${format}`, {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(options)});
  if (!answer.ok) { show(await answer.json(), true); return; }
  const name = (answer.headers.get("Content-Disposition") || "").split('"')[1] || format;
  const link = element("a", "", {href: URL.createObjectURL(await answer.blob()), download: name});
  link.click(); URL.revokeObjectURL(link.href);
});
const heads = [...document.querySelectorAll("th[data-key]")];
for (const head of heads) {
  const button = element("button", head.textContent, {type: "button"});
  button.addEventListener("click", () => {
    sorted = {key: head.dataset.key, sign: sorted && sorted.key === head.dataset.key ? -sorted.sign : 1}; taskTable();
    for (const each of heads) each.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", sorted.sign > 0 ? "ascending" : "descending");
  });
  head.replaceChildren(button);
}
document.addEventListener("keydown", event => {
  if (!(event.ctrlKey || event.metaKey) || event.target.tagName === "INPUT") return;
  if (event.key === "z") { order("undo"); event.preventDefault(); }
  if (event.key === "y") { order("redo"); event.preventDefault(); }
});
async function open() {
  const told = await (await fetch("/api/state")).json();
  if (told.busy && !told.modes.length) { show(told); say("finding the first schedule…", ""); setTimeout(open, 300); } else { show(told); followLink(); if (!told.solved) order("settle"); }
}
function followLink() { // shows the table, the time and the job that the address names
  const view = new URLSearchParams(location.hash.slice(1)).get("view");
  if ([...$("mode").options].some(option => option.value === view)) { $("mode").value = view; show(state); viewer.go(location.hash); }
}
addEventListener("hashchange", followLink);
addEventListener("beforeunload", event => { if (state && state.unkept) event.preventDefault(); }); // the browser asks
open();

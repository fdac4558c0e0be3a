"use strict";
// The report: charts by the viewer, and tables whose rows are made as they are looked at; print takes all rows of those that are unfolded.
const SCENE = JSON.parse(document.getElementById("scene").textContent), STEP = 100;
const viewers = new Map();
for (const canvas of document.querySelectorAll("canvas.viewer")) {
  const facts = canvas.nextElementSibling;
  const viewer = new Viewer(canvas, {chosen(job) { facts.textContent = job ? viewer.describe(job) : ""; }});
  viewer.show(SCENE, canvas.dataset.mode);
  canvas.style.height = `${Math.min(20000, viewer.tall())}px`;
  viewers.set(canvas.dataset.mode, viewer);
  addEventListener("hashchange", () => { if (viewer.go(location.hash)) canvas.scrollIntoView(); });
}
dispatchEvent(new Event("hashchange"));

const TABLES = {
  tasks: {title: "Tasks: response time, margin to the deadline, start jitter, gaps", heads: ["Task", "Period", "Jobs", "Worst response", "Margin", "Start jitter", "Gaps"], rows(table) {
    const place = SCENE.modes.indexOf(table);
    return SCENE.tasks.filter(task => task.figures[place].jobs).map(task => {
      const own = task.figures[place];
      return {task, cells: [task.name, task.period, own.jobs, own.response || "", own.margin || "", own.jitter || "", own.gaps],
        keys: [task.name, parseFloat(task.period), own.jobs, own.response_ms || 0, own.margin_ms || 0, own.jitter_ms || 0, own.gaps]};
    });
  }},
  jobs: {title: "Jobs by start", heads: ["Task", "Job", "Start", "End", "Version", "Units", "Predecessor"], rows(table) {
    const own = table.jobs.map((job, place) => ({job, waits: (table.waits || [])[place] || ""}));
    return own.filter(({job}) => 0 <= job[4] && job[4] < table.length).sort((a, b) => a.job[4] - b.job[4]).map(({job, waits}) => {
      const task = SCENE.tasks[job[0]], units = job[3].map(lane => SCENE.units[lane]).join(" ");
      const end = job[8].length > 1 ? `${job[7]}, ${job[8].length - 1} gaps` : job[7];
      return {task, cells: [task.name, job[1], job[6], end, job[2], units, waits], keys: [task.name, job[1], job[4], job[5], job[2], units, waits]};
    });
  }},
};

for (const room of document.querySelectorAll("div.rows")) {
  const table = [...SCENE.modes, ...SCENE.switches].find(each => each.name === room.dataset.mode), kind = TABLES[room.dataset.kind];
  const whole = kind.rows(table), make = (name, properties) => Object.assign(document.createElement(name), properties);
  let shown = whole, made = 0, order = null;
  const box = make("details", {open: room.dataset.kind === "jobs" && whole.length <= 12}), body = make("tbody");
  const search = make("input", {type: "search", placeholder: "find", ariaLabel: `find in ${kind.title}`});
  const more = make("button", {type: "button", textContent: "more", onclick: () => add(10 * STEP)}), titles = make("tr");
  kind.heads.forEach((textContent, column) => {
    const title = make("th"), onclick = () => { order = {column, sign: order && order.column === column ? -order.sign : 1}; again(); };
    title.append(make("button", {type: "button", className: "sort", textContent, onclick})); titles.append(title);
  });
  const add = count => {
    const rows = shown.slice(made, made + count).map(row => {
      const line = make("tr"), swatch = make("i", {className: "k"});
      for (const textContent of row.cells) line.append(make("td", {textContent}));
      swatch.style.background = row.task.colour; line.cells[0].prepend(swatch);
      return line;
    });
    body.append(...rows); made += rows.length; more.hidden = made >= shown.length;
  };
  const again = () => {
    const needle = search.value.toLowerCase();
    shown = whole.filter(row => row.cells.some(text => String(text).toLowerCase().includes(needle)));
    if (order) shown.sort((a, b) => order.sign * (a.keys[order.column] < b.keys[order.column] ? -1 : a.keys[order.column] > b.keys[order.column] ? 1 : 0));
    body.replaceChildren(); made = 0; add(STEP);
  };
  search.oninput = again;
  const wide = make("div", {className: "wide"}), grid = make("table"), head = make("thead");
  head.append(titles); grid.append(head, body); wide.append(grid);
  box.append(make("summary", {textContent: `${kind.title}: ${whole.length}`}), search, wide, more); room.append(box);
  again();
  let before = 0;
  addEventListener("beforeprint", () => { before = made; if (box.open) add(shown.length); });
  addEventListener("afterprint", () => { while (made > before && body.lastChild) { body.lastChild.remove(); made -= 1; } more.hidden = made >= shown.length; });
}

// Paper cannot be unfolded: short tables are unfolded for print. The rest is printed where the reader has unfolded it.
let folded = [];
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("details:not([open], .aside)")].filter(box => box.querySelectorAll("tbody tr").length <= 50);
  for (const box of folded) box.open = true;
});
addEventListener("afterprint", () => { for (const box of folded) box.open = false; });

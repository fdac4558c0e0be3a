"use strict";
// Large schedules: charts by the viewer, and tables whose rows are made as they are looked at; print takes all rows of those that are unfolded.
const SCENE = JSON.parse(document.getElementById("scene").textContent), STEP = 100;
const viewers = new Map();
for (const canvas of document.querySelectorAll("canvas.viewer")) {
  const facts = canvas.nextElementSibling;
  const viewer = new Viewer(canvas, {
    chosen(job) {
      facts.textContent = job ? `${job.name} job ${job.index}, ${job.version}: ${job.startText} to ${job.endText} on ` +
        job.lanes.map(lane => SCENE.units[lane]).join(", ") : "";
    },
    moved() {},
  });
  viewer.fixed = true;
  viewer.show(SCENE, canvas.dataset.mode);
  canvas.style.height = `${Math.max(240 + METER * viewer.meters.length, Math.min(20000, viewer.tall()))}px`;
  viewers.set(canvas.dataset.mode, viewer);
}

const TABLES = {
  tasks: {title: "Tasks", heads: ["Task", "Period", "Jobs", "Worst response", "Margin", "Start jitter", "Gaps"], rows(place) {
    return SCENE.tasks.filter(task => task.figures[place].jobs).map(task => {
      const own = task.figures[place];
      return {cells: [task.name, task.period, own.jobs, own.response || "", own.margin || "", own.jitter || "", own.gaps],
        keys: [task.name, parseFloat(task.period), own.jobs, own.response_ms || 0, own.margin_ms || 0, own.jitter_ms || 0, own.gaps]};
    });
  }},
  jobs: {title: "Jobs by start", heads: ["Task", "Job", "Start", "End", "Version", "Units"], rows(place) {
    return [...SCENE.modes[place].jobs].sort((a, b) => a[4] - b[4]).map(job => {
      const name = SCENE.tasks[job[0]].name, units = job[3].map(lane => SCENE.units[lane]).join(" ");
      return {cells: [name, job[1], job[6], job[7], job[2], units], keys: [name, job[1], job[4], job[5], job[2], units]};
    });
  }},
};

for (const room of document.querySelectorAll("div.rows")) {
  const place = SCENE.modes.findIndex(mode => mode.name === room.dataset.mode), kind = TABLES[room.dataset.kind];
  const whole = kind.rows(place);
  let shown = whole, made = 0, order = null;
  const box = document.createElement("details"), head = document.createElement("summary"), search = document.createElement("input");
  const table = document.createElement("table"), body = document.createElement("tbody"), more = document.createElement("button");
  head.textContent = `${kind.title}: ${whole.length}`;
  search.type = "search"; search.placeholder = "find"; search.setAttribute("aria-label", `find in ${kind.title}`);
  more.type = "button"; more.textContent = "more";
  const titles = document.createElement("tr");
  kind.heads.forEach((text, column) => {
    const title = document.createElement("th"), button = document.createElement("button");
    button.type = "button"; button.className = "sort"; button.textContent = text;
    button.onclick = () => { order = {column, sign: order && order.column === column ? -order.sign : 1}; again(); };
    title.append(button); titles.append(title);
  });
  const add = count => {
    const rows = shown.slice(made, made + count).map(row => {
      const line = document.createElement("tr");
      for (const text of row.cells) line.append(Object.assign(document.createElement("td"), {textContent: text}));
      return line;
    });
    body.append(...rows); made += rows.length; more.hidden = made >= shown.length;
  };
  const again = () => {
    const needle = search.value.toLowerCase();
    shown = needle ? whole.filter(row => row.cells.some(text => String(text).toLowerCase().includes(needle))) : [...whole];
    if (order) shown.sort((a, b) => order.sign * (a.keys[order.column] < b.keys[order.column] ? -1 : a.keys[order.column] > b.keys[order.column] ? 1 : 0));
    body.replaceChildren(); made = 0; add(STEP);
  };
  search.oninput = again; more.onclick = () => add(10 * STEP);
  table.append(document.createElement("thead"), body); table.tHead.append(titles);
  const wide = document.createElement("div"); wide.className = "wide"; wide.append(table);
  box.append(head, search, wide, more); room.append(box);
  again();
  let before = 0;
  addEventListener("beforeprint", () => { before = made; if (box.open) add(shown.length); });
  addEventListener("afterprint", () => { while (made > before && body.lastChild) { body.lastChild.remove(); made -= 1; } more.hidden = made >= shown.length; });
}

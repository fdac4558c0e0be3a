"use strict";
// Comfort only: zoom, quick tooltips, and the jobs of one task at a time. The page is complete without it.
for (const plot of document.querySelectorAll("svg.plot:not(.way)")) {
  const scroll = plot.parentElement, bar = document.createElement("div");
  const levels = Number(document.body.dataset.zoomLevels);
  let level = 0;
  const button = (text, label, step) => {
    const made = document.createElement("button");
    made.type = "button"; made.textContent = text; made.setAttribute("aria-label", label);
    made.onclick = () => zoom(level + step);
    bar.append(made);
    return made;
  };
  const zoom = (next) => {
    const middle = (scroll.scrollLeft + scroll.clientWidth / 2) / scroll.scrollWidth;
    level = next;
    plot.setAttribute("class", "plot z" + level);
    plot.style.width = 100 * 2 ** level + "%";
    scroll.scrollLeft = middle * scroll.scrollWidth - scroll.clientWidth / 2;
    less.disabled = level === 0; more.disabled = level === levels - 1;
    scale.textContent = 2 ** level + "×";
  };
  bar.className = "zoom";
  bar.append("Zoom");
  const less = button("−", "Zoom out", -1), scale = document.createElement("span");
  bar.append(scale);
  const more = button("+", "Zoom in", 1);
  scroll.parentElement.before(bar);
  zoom(0);

  const bars = [...plot.querySelectorAll("rect.j")];
  const task = (rect) => rect.textContent.slice(0, rect.textContent.indexOf("\n")).replace(/ #\d+$/, "");
  for (const entry of scroll.parentElement.nextElementSibling.querySelectorAll("li[data-task]")) {
    const show = (on) => bars.forEach((rect) => rect.classList.toggle("dim", on && task(rect) !== entry.dataset.task));
    entry.onpointerenter = () => show(true);
    entry.onpointerleave = () => show(false);
  }
}
const tip = document.createElement("div");
tip.id = "tip"; tip.hidden = true; tip.setAttribute("aria-hidden", "true");
document.body.append(tip);
let muted = null;
document.addEventListener("pointermove", (event) => {
  const rect = event.target.closest ? event.target.closest("rect.j") : null;
  if (muted && muted.rect !== rect) { muted.rect.append(muted.title); muted = null; }
  tip.hidden = !rect;
  if (!rect) return;
  if (!muted) {
    const title = rect.querySelector("title");
    tip.textContent = title.textContent;
    title.remove();  // else the browser shows it a second time, later
    muted = { rect, title };
  }
  const left = Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8);
  const below = event.clientY + 18 + tip.offsetHeight < innerHeight;
  tip.style.left = Math.max(4, left) + "px";
  tip.style.top = (below ? event.clientY + 18 : event.clientY - tip.offsetHeight - 10) + "px";
});
for (const table of document.querySelectorAll("table.sortable")) {
  const search = Object.assign(document.createElement("input"), {type: "search", placeholder: "find"});
  search.setAttribute("aria-label", "find in the table");
  search.oninput = () => {
    for (const row of table.tBodies[0].rows) row.hidden = !row.textContent.toLowerCase().includes(search.value.toLowerCase());
  };
  table.parentElement.before(search);
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    let sign = -1;
    const button = Object.assign(document.createElement("button"), {type: "button", className: "sort", textContent: head.textContent});
    const key = (row) => { const cell = row.cells[column]; return cell.dataset.v !== undefined ? Number(cell.dataset.v) : isNaN(parseFloat(cell.textContent)) ? cell.textContent : parseFloat(cell.textContent); };
    button.onclick = () => {
      sign = -sign;
      const rows = [...table.tBodies[0].rows].sort((a, b) => { const x = key(a), y = key(b); return sign * (x < y ? -1 : x > y ? 1 : 0); });
      table.tBodies[0].append(...rows);
    };
    head.replaceChildren(button);
  });
}

// Paper cannot be unfolded: short tables are unfolded for print. The rest is printed where the reader has unfolded it.
let folded = [];
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("details:not([open], .aside)")].filter(box => box.querySelectorAll("tbody tr").length <= 50);
  for (const box of folded) box.open = true;
});
addEventListener("afterprint", () => { for (const box of folded) box.open = false; });

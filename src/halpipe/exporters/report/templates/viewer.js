"use strict";
// One table of a schedule, a mode or a switch, on a canvas: lanes are units, boxes are jobs; below them the load of units and resources, and the whole at a glance.
// Zoom with the wheel, two fingers or + and -, pan by dragging, choose with a click or the arrow keys. Dragging a job, or Alt with an arrow, asks the owner to move it.
// Shift with a click sets a cursor, M one at the chosen job, Escape removes them.
const METER = 30, FONT = "12px system-ui, sans-serif"; // pixels

class Viewer {
  constructor(canvas, owner) {
    this.canvas = canvas;
    this.owner = owner; // {chosen(job), moved(job, start, lane)}; without moved, nothing can be
    this.context = canvas.getContext("2d");
    this.scene = null; this.mode = null;
    this.from = 0; this.to = 1; this.filter = ""; this.chain = null; this.heat = null; this.pinned = new Set();
    this.cursors = []; this.selected = null; this.hovered = null; this.drag = null; this.drawn = false;
    this.wide = new Map(); // by name: its width in pixels
    this.fingers = new Map(); // by pointer: where it is
    const on = (name, act, options) => canvas.addEventListener(name, act.bind(this), options);
    on("wheel", this.onWheel, {passive: false});
    on("pointerdown", this.onDown); on("pointermove", this.onMove); on("pointerup", this.onUp); on("pointercancel", this.onUp);
    on("pointerleave", () => { this.tip.hidden = true; });
    on("keydown", this.onKey);
    const sizes = new ResizeObserver(() => this.draw()); // a page that grows or shrinks moves other lanes into sight
    sizes.observe(canvas); sizes.observe(document.body);
    for (const name of ["scroll", "resize"]) addEventListener(name, () => this.draw(), {passive: true});
    addEventListener("beforeprint", () => { this.whole = true; if (this.scene) this.paint(); this.whole = false; });
    this.tip = document.createElement("div"); this.tip.hidden = true; this.tip.className = "tip";
    document.body.append(this.tip);
    canvas.before(this.tools());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  show(scene, modeName) {
    const before = this.mode, tables = [...scene.modes, ...scene.switches];
    this.scene = scene;
    this.mode = tables.find(table => table.name === modeName) || tables[0] || null;
    if (!this.mode) { this.draw(); return; }
    const {name, begin, end} = this.mode;
    this.length = end - begin; this.still = !this.owner.moved || !this.mode.cycle;
    if (!before || before.name !== name || before.begin !== begin || before.end !== end) { this.from = begin; this.to = end; this.cursors = []; }
    this.jobs = this.mode.jobs.map((row, place) => ({
      place, task: row[0], index: row[1], version: row[2], lanes: row[3], start: row[4], end: row[5],
      startText: row[6], endText: row[7], parts: row[8].length ? row[8] : [[row[4], row[5]]], gaps: row[8].length > 1, phases: row[9],
      name: scene.tasks[row[0]].name, colour: scene.tasks[row[0]].colour,
    }));
    this.meters = [{name: "busy units", steps: this.busyUnits()}, ...this.mode.meters];
    this.context.font = FONT;
    this.names = Math.max(90, ...scene.units.map(unit => 12 + this.context.measureText(unit).width));
    this.byLane = scene.units.map((_, lane) => this.jobs.filter(job => job.lanes.includes(lane)).sort((a, b) => a.start - b.start));
    if (this.selected) { // its details are shown again
      this.selected = this.jobs.find(job => job.name === this.selected.name && job.index === this.selected.index) || null;
      this.owner.chosen(this.selected);
    }
    this.draw();
  }

  tall() { // pixels in which every lane can be read
    const units = this.scene.units.length, lane = units <= 16 ? 26 : 14;
    return 56 + (lane + (this.mode && this.mode.strip ? 10 : 0)) * units + METER * ((this.meters || []).length + 1);
  }
  // By how much a job is shifted to be drawn once more at the beginning of the cycle, where it continues.
  shifts(end) {
    const found = [0];
    for (let shift = -this.length; this.mode.cycle && end + shift > this.mode.begin; shift -= this.length) found.push(shift);
    return found;
  }

  draw() { if (!this.drawn) { this.drawn = true; requestAnimationFrame(() => { this.drawn = false; this.paint(); }); } }

  colours() {
    const style = getComputedStyle(this.canvas), get = name => style.getPropertyValue(name).trim();
    return {back: get("--back") || "#fff", ink: get("--ink") || "#111", faint: get("--faint") || "#666", line: get("--line") || "#ccc",
      lane: get("--lane") || "#f4f4f4", accent: get("--accent") || "#15c", bad: get("--bad") || "#a00"};
  }

  layout() {
    const ratio = this.whole ? 2 : window.devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    if (this.canvas.width !== Math.round(box.width * ratio) || this.canvas.height !== Math.round(box.height * ratio)) {
      this.canvas.width = Math.round(box.width * ratio); this.canvas.height = Math.round(box.height * ratio);
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.width = box.width; this.height = box.height;
    this.left = Math.min(this.width / 4, this.names); this.top = this.mode && this.mode.regions.length ? 40 : 24;
    this.seen = [-box.top, window.innerHeight - box.top]; // what of the canvas is in sight
    const below = METER * ((this.meters || []).length + 1) + 6;
    this.lane = Math.max(8, (this.height - this.top - below) / Math.max(1, this.scene.units.length));
    this.bar = (this.mode && this.mode.strip ? .6 : 1) * this.lane - 4;
  }

  x(time) { return this.left + (time - this.from) / (this.to - this.from) * (this.width - this.left); }
  time(x) { return this.from + (x - this.left) / (this.width - this.left) * (this.to - this.from); }

  paint(pen = this.context) {
    if (!this.scene) return;
    this.layout();
    const tone = this.colours();
    pen.fillStyle = tone.back; pen.fillRect(0, 0, this.width, this.height);
    if (!this.mode) { pen.fillStyle = tone.faint; pen.fillText("no schedule yet", this.left, this.top + 14); return; }
    this.paintLanes(pen, tone);
    this.paintAxis(pen, tone);
    pen.save(); pen.beginPath(); pen.rect(this.left, 0, this.width - this.left, this.height); pen.clip();
    this.byLane.forEach((jobs, lane) => this.paintJobs(pen, tone, jobs, lane));
    this.meters.forEach((meter, row) => this.paintMeter(pen, tone, meter, row));
    this.paintRegions(pen, tone);
    if (this.mode.strip) this.paintStrip(pen, tone);
    if (this.chain && this.mode.cycle) this.paintChain(pen, tone);
    this.paintMap(pen, tone);
    this.paintCursors(pen, tone);
    pen.restore();
  }

  paintLanes(pen, tone) {
    pen.font = FONT; pen.textBaseline = "middle"; pen.textAlign = "left";
    this.scene.units.forEach((unit, lane) => {
      const y = this.top + lane * this.lane;
      pen.fillStyle = lane % 2 ? tone.back : tone.lane; pen.fillRect(0, y, this.width, this.lane);
      pen.fillStyle = tone.ink;
      if (this.lane >= 12) this.paintName(pen, tone.ink, unit, 6, this.left - 4, y + this.lane / 2);
    });
    pen.fillStyle = tone.faint;
    this.meters.forEach((meter, row) => this.paintName(pen, tone.faint, meter.name, 6, this.left - 4, this.base(row) - METER / 2 + 4));
  }

  base(row) { return this.top + this.scene.units.length * this.lane + (row + 1) * METER; }

  paintMeter(pen, tone, meter, row) { // the most in each column of pixels; what is above the capacity in another colour
    const base = this.base(row), full = METER - 6, columns = new Float32Array(Math.ceil(this.width) + 1), steps = meter.steps;
    for (let n = 0; n < steps.length; n++) {
      const begin = this.x(steps[n][0]), end = this.x(n + 1 < steps.length ? steps[n + 1][0] : this.mode.end);
      if (!steps[n][1] || end < this.left || begin > this.width) continue;
      const last = Math.min(this.width, Math.max(begin + 1, end));
      for (let x = Math.max(0, Math.round(begin)); x < last; x++) columns[x] = Math.max(columns[x], steps[n][1]);
    }
    for (let x = 0, end; x < columns.length; x = end) {
      for (end = x + 1; end < columns.length && columns[end] === columns[x];) end++;
      const high = full * Math.min(1, columns[x]);
      if (!high) continue;
      pen.fillStyle = columns[x] > 1 + 1e-9 ? tone.bad : tone.accent; pen.globalAlpha = .45;
      pen.fillRect(x, base - high, end - x, high); pen.globalAlpha = 1;
    }
    pen.strokeStyle = tone.line; pen.lineWidth = 1; pen.beginPath();
    for (const y of [base, base - full]) { pen.moveTo(this.left, Math.round(y) + .5); pen.lineTo(this.width, Math.round(y) + .5); }
    pen.stroke();
  }

  paintAxis(pen, tone) {
    const span = this.to - this.from, rough = span / Math.max(2, Math.min(8, (this.width - this.left) / 75)), power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(n => n * power).find(n => n >= rough);
    pen.strokeStyle = tone.line; pen.fillStyle = tone.faint; pen.textAlign = "center"; pen.lineWidth = 1;
    for (let tick = Math.ceil(this.from / step) * step; tick <= this.to + step / 1e6; tick += step) {
      const x = Math.round(this.x(tick)) + .5;
      pen.beginPath(); pen.moveTo(x, this.top - 5); pen.lineTo(x, this.height); pen.stroke();
      pen.fillText(`${+tick.toFixed(6)} ms`, Math.min(x, this.width - 24), 10);
    }
    pen.textAlign = "left";
  }

  fill(job) {
    if (!this.heat) return job.colour;
    const margin = this.heat[job.name];
    if (margin === undefined) return "#cccccc";
    const share = Math.max(0, Math.min(1, margin));
    return `hsl(${Math.round(20 + 190 * share)} 70% 70%)`;
  }

  paintJobs(pen, tone, jobs, lane) {
    const y = this.top + lane * this.lane + 2, high = this.bar;
    if (!this.whole && (y + high < this.seen[0] || y > this.seen[1])) return;
    let last = -1;
    for (const job of jobs) {
      const faded = this.filter && !job.name.toLowerCase().includes(this.filter) && !this.scene.units[lane].toLowerCase().includes(this.filter);
      for (const [start, end] of job.parts) {
        for (const shift of this.shifts(end)) {
          const begin = this.x(start + shift), until = this.x(end + shift);
          if (until < this.left || begin > this.width) continue;
          const wide = Math.max(1, until - begin);
          if (wide <= 1 && Math.round(begin) === last && job !== this.selected) continue; // as many as there are pixels
          last = Math.round(begin);
          pen.globalAlpha = faded ? .15 : 1;
          pen.fillStyle = this.fill(job); pen.fillRect(begin, y, wide, high);
          if (wide > 3) { pen.strokeStyle = "#0006"; pen.lineWidth = 1; pen.strokeRect(begin + .5, y + .5, wide - 1, high - 1); }
          if (this.pinned.has(`${this.mode.name} ${job.task} ${job.index}`)) { pen.fillStyle = tone.ink; pen.fillRect(begin, y, wide, 3); }
          if (job === this.selected || job === this.hovered) { pen.strokeStyle = tone.accent; pen.lineWidth = 2.5; pen.strokeRect(begin + 1, y + 1, Math.max(1, wide - 2), high - 2); }
          if (wide > 34 && high > 11) this.paintName(pen, "#111", job.name, Math.max(begin, this.left) + 4, Math.min(until, this.width) - 4, y + high / 2);
        }
      }
      if (job.gaps) this.paintGaps(pen, tone, job, y + high / 2);
      this.paintPhases(pen, job, y + high);
    }
    pen.globalAlpha = 1;
    if (this.drag && this.drag.job && !this.still && (this.drag.lane < 0 ? this.drag.job.lanes.includes(lane) : lane === this.drag.lane)) {
      const job = this.drag.job;
      pen.globalAlpha = .55; pen.fillStyle = tone.accent;
      pen.fillRect(this.x(job.start + this.drag.by), y, Math.max(2, this.x(job.end) - this.x(job.start)), high);
      pen.globalAlpha = 1;
    }
  }

  paintGaps(pen, tone, job, y) { // thin lines from part to part, also where they go on at the beginning of the cycle
    pen.strokeStyle = tone.ink; pen.lineWidth = 1; pen.beginPath();
    for (let n = 1; n < job.parts.length; n++) {
      for (const shift of this.shifts(job.end)) {
        pen.moveTo(this.x(job.parts[n - 1][1] + shift), y); pen.lineTo(this.x(job.parts[n][0] + shift), y);
      }
    }
    pen.stroke();
  }

  paintName(pen, colour, name, begin, end, y) { // or as much of it as there is room for
    const wide = this.wide.get(name) || pen.measureText(name).width, room = end - begin;
    this.wide.set(name, wide);
    pen.fillStyle = colour;
    if (wide <= room) pen.fillText(name, begin, y);
    else if (room > 24) pen.fillText(`${name.slice(0, Math.floor(name.length * (room - 12) / wide))}…`, begin, y, room);
  }

  paintPhases(pen, job, foot) { // stripes at the foot of a job: when it uses a resource
    for (const [resource, begin, end] of job.phases) {
      pen.fillStyle = this.scene.resources[resource].colour;
      for (const shift of this.shifts(end)) {
        const x = this.x(begin + shift), wide = this.x(end + shift) - x;
        if (wide > 1 && x < this.width && x + wide > this.left) pen.fillRect(x, foot - 3 * (1 + resource % 3), wide, 3);
      }
    }
  }

  paintRegions(pen, tone) {
    for (const {begin, end, text, kind} of this.mode.regions) {
      const x = Math.max(this.left, this.x(begin)), until = Math.min(this.width, this.x(end));
      if (until <= x) continue;
      if (kind === "table") { pen.globalAlpha = .14; pen.fillStyle = tone.accent; pen.fillRect(x, this.top, until - x, this.height - this.top); pen.globalAlpha = 1; }
      pen.strokeStyle = tone.line; pen.lineWidth = 1; pen.strokeRect(x + .5, 19.5, until - x - 1, this.height - 20);
      this.paintName(pen, tone.faint, text, x + 4, until - 2, 30);
    }
  }

  paintStrip(pen, tone) { // what ran, or another schedule, in the lower part of each lane; what deviates comes last
    const high = this.lane - this.bar - 7;
    for (const [lanes, start, end, task, mark] of this.mode.strip.boxes) {
      for (const lane of lanes) {
        const x = this.x(start), y = this.top + lane * this.lane + this.bar + 4, wide = Math.max(1, this.x(end) - x);
        if (x > this.width || x + wide < this.left) continue;
        pen.fillStyle = mark === "extra" || mark === "over" || mark === "delay" ? tone.bad : this.scene.tasks[task].colour;
        if (mark === "delay") pen.fillRect(x, y + high / 2, wide, 1.5);
        else if (mark !== "missing") pen.fillRect(x, y, wide, high);
        if (mark === "off" || mark === "missing") {
          pen.setLineDash(mark === "off" ? [] : [4, 3]); pen.strokeStyle = tone.bad; pen.lineWidth = 1.5;
          pen.strokeRect(x + .75, y + .75, Math.max(1, wide - 1.5), high - 1.5); pen.setLineDash([]);
        }
      }
    }
  }

  paintMap(pen, tone) { // the whole table below, with a frame around what is shown
    const {from, to} = this, {begin, end} = this.mode, row = this.meters.length;
    Object.assign(this, {from: begin, to: end});
    this.paintMeter(pen, tone, this.meters[0], row);
    const x = this.x(from), wide = this.x(to) - x;
    Object.assign(this, {from, to});
    pen.strokeStyle = tone.ink; pen.lineWidth = 1.5; pen.strokeRect(x + 1, this.base(row) - METER + 6, Math.max(2, wide - 2), METER - 6);
  }

  paintCursors(pen, tone) {
    pen.fillStyle = pen.strokeStyle = tone.bad; pen.lineWidth = 1;
    const places = this.cursors.map(time => Math.round(this.x(time)) + .5), texts = this.cursors.map(instant);
    for (const x of places) { pen.beginPath(); pen.moveTo(x, this.top - 5); pen.lineTo(x, this.height); pen.stroke(); }
    if (texts.length === 2) texts.push(`difference ${instant(Math.abs(this.cursors[1] - this.cursors[0]))}`);
    const text = texts.join("   "), y = this.base(this.meters.length) - METER / 2 + 3, wide = pen.measureText(text).width, x = Math.max(this.left, Math.min(this.width - wide - 8, Math.max(...places) + 4));
    if (!text) return;
    pen.fillStyle = tone.back; pen.fillRect(x - 2, y - 8, wide + 6, 16);
    pen.fillStyle = tone.bad; pen.fillText(text, x, y);
  }

  // When a job reads and writes: at its start and end, or at its release and a logical execution time after it.
  data(job) {
    const [phase, period, length] = this.scene.tasks[job.task].let, release = phase + period * job.index;
    return length ? {lanes: job.lanes, read: release, write: release + length} : {lanes: job.lanes, read: job.start, write: job.end};
  }

  // Lines from writing to the first reading after it; those over the edge of the cycle leave at its end and come in at its begin.
  paintChain(pen, tone) {
    pen.strokeStyle = tone.accent; pen.fillStyle = tone.accent; pen.lineWidth = 1.5;
    const runs = this.chain.map(task => this.jobs.filter(job => job.task === task).map(job => this.data(job)));
    const length = this.length, middle = job => this.top + job.lanes[0] * this.lane + this.bar / 2 + 2;
    for (let stage = 0; stage + 1 < runs.length; stage++) {
      for (const job of runs[stage]) {
        const reads = runs[stage + 1].map(other => [other.read + length * Math.max(0, Math.ceil((job.write - 1e-9 - other.read) / length)), other]);
        const [read, next] = reads.sort((a, b) => a[0] - b[0])[0] || [];
        if (!next) continue;
        for (const back of new Set([0, length * Math.floor(read / length)])) {
          const x = this.x(read - back);
          pen.beginPath(); pen.moveTo(this.x(job.write - back), middle(job)); pen.lineTo(x, middle(next)); pen.stroke();
          pen.beginPath(); pen.arc(x, middle(next), 3, 0, 7); pen.fill();
        }
      }
    }
  }

  at(x, y) {
    const lane = Math.floor((y - this.top) / this.lane), time = this.time(x);
    if (!this.byLane || !this.byLane[lane] || x < this.left) return null;
    const within = ([start, end]) => this.shifts(end).some(shift => start + shift <= time && time < end + shift);
    return this.byLane[lane].find(job => job.parts.some(within)) || null;
  }
  boxAt(x, y) { // in the lower part of a lane
    const lane = Math.floor((y - this.top) / this.lane), time = this.time(x);
    if (!this.mode.strip || (y - this.top) % this.lane < this.bar + 3) return null;
    return this.mode.strip.boxes.findLast(([lanes, start, end]) => lanes.includes(lane) && start <= time && time < end) || null;
  }
  describe(job) {
    const spare = this.heat ? this.heat[job.name] : undefined, units = job.lanes.map(lane => this.scene.units[lane]).join(", ");
    return `${job.name} job ${job.index}, ${job.version}: ${job.startText} to ${job.endText} on ${units}` + (job.gaps ? `, ${job.parts.length} parts` : "") +
      (spare === undefined ? "" : `; its WCET can grow by ${Math.floor(spare * 1000) / 10} %`);
  }

  view(from, span) { // shows so much of the table, and nothing beyond its edges
    span = Math.min(this.length, Math.max(this.length / 1e6, span));
    this.from = Math.max(this.mode.begin, Math.min(this.mode.end - span, from)); this.to = this.from + span;
    this.draw();
  }
  zoom(factor, around = (this.from + this.to) / 2) { this.view(around - (around - this.from) * factor, (this.to - this.from) * factor); }
  pan(by) { this.view(this.from + by, this.to - this.from); }

  select(job) { this.selected = job; this.owner.chosen(job); this.draw(); }
  onWheel(event) {
    if (!this.mode) return;
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.pan((event.deltaX || event.deltaY) / this.width * (this.to - this.from));
    else this.zoom(event.deltaY > 0 ? 1.2 : 1 / 1.2, this.time(event.offsetX));
  }
  onDown(event) {
    if (!this.mode) return;
    this.canvas.focus(); this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, event.offsetX);
    if (this.fingers.size > 1) { this.drag = null; return; }
    if (event.shiftKey) { this.mark(this.time(event.offsetX)); return; }
    const isMap = event.offsetY > this.base(this.meters.length - 1), job = isMap ? null : this.at(event.offsetX, event.offsetY);
    if (job) this.select(job);
    if (isMap) this.overview(event);
    this.drag = {job, isMap, x: event.offsetX, from: this.from, by: 0, lane: this.laneFor(job, event.offsetY), moved: false};
  }
  onMove(event) {
    if (!this.mode) return;
    if (this.fingers.size > 1) { this.pinch(event); return; }
    const drag = this.drag;
    if (drag && drag.isMap) { this.overview(event); return; }
    if (!drag) {
      const job = this.at(event.offsetX, event.offsetY), box = this.boxAt(event.offsetX, event.offsetY);
      this.hint(event, box ? box[5] : job ? this.describe(job) : "");
      if (job !== this.hovered) { this.hovered = job; this.owner.chosen(job || this.selected); this.draw(); }
      return;
    }
    const by = (event.offsetX - drag.x) / (this.width - this.left) * (this.to - this.from);
    const isAside = Math.abs(event.offsetX - drag.x) > 3;
    if (drag.job) drag.lane = this.laneFor(drag.job, event.offsetY);
    if (isAside || (drag.job && drag.lane >= 0 && drag.lane !== drag.job.lanes[0])) drag.moved = true;
    if (drag.job && !this.still) { drag.by = isAside ? by : 0; this.draw(); } // a job that is moved to another unit keeps its start
    else this.view(drag.from - by, this.to - this.from);
  }
  overview(event) { // goes to where the pointer is in the picture of the whole
    const share = (event.offsetX - this.left) / (this.width - this.left), span = this.to - this.from;
    this.view(this.mode.begin + share * this.length - span / 2, span);
  }
  hint(event, text) {
    this.tip.hidden = !text; this.tip.textContent = text;
    const {style, offsetWidth, offsetHeight} = this.tip, isBelow = event.clientY + 18 + offsetHeight < innerHeight;
    style.left = `${Math.max(4, Math.min(event.clientX + 14, innerWidth - offsetWidth - 8))}px`;
    style.top = `${isBelow ? event.clientY + 18 : event.clientY - offsetHeight - 10}px`;
  }
  mark(time) { // at the edge of a job that is near
    const near = (this.to - this.from) * 6 / (this.width - this.left);
    const edges = this.jobs.flatMap(job => job.parts.flat()).flatMap(edge => this.shifts(edge).map(shift => edge + shift));
    const edge = edges.reduce((best, other) => Math.abs(other - time) < Math.abs(best - time) ? other : best, time + near);
    this.cursors = [...this.cursors.slice(-1), Math.abs(edge - time) < near ? edge : time];
    this.draw();
  }
  pinch(event) {
    if (!this.fingers.has(event.pointerId)) return;
    const [first, second] = this.fingers.values();
    this.fingers.set(event.pointerId, event.offsetX);
    const [now, other] = this.fingers.values(), gap = (one, two) => Math.max(1, Math.abs(one - two));
    this.zoom(gap(first, second) / gap(now, other), this.time((first + second) / 2));
    this.pan((first + second - now - other) / 2 / (this.width - this.left) * (this.to - this.from));
  }
  onUp(event) {
    this.fingers.delete(event.pointerId);
    const drag = this.drag; this.drag = null;
    if (drag && drag.job && drag.moved && !this.still) this.move(drag.job, drag.job.start + drag.by, drag.lane);
    this.draw();
  }
  laneFor(job, y) { // -1: the job stays on its units, as one that takes several of them together
    const lane = Math.floor((y - this.top) / this.lane);
    return job && job.lanes.length === 1 && lane >= 0 && lane < this.scene.units.length ? lane : -1;
  }
  move(job, start, lane = -1) {
    if (this.still) return;
    const isElsewhere = lane >= 0 && lane !== job.lanes[0];
    if (start === job.start) { if (isElsewhere) this.owner.moved(job, start, lane); return; }
    const grid = 10 ** Math.floor(Math.log10(Math.max(1e-6, (this.to - this.from) / 200)));
    const snapped = Math.round(start / grid) * grid;
    this.owner.moved(job, ((snapped % this.length) + this.length) % this.length, isElsewhere ? lane : -1);
  }
  onKey(event) {
    if (!this.mode) return;
    const step = (this.to - this.from) / 50, key = event.key;
    if (event.altKey && this.selected && (key === "ArrowLeft" || key === "ArrowRight")) this.move(this.selected, this.selected.start + (key === "ArrowLeft" ? -step : step));
    else if (event.altKey && this.selected && this.selected.lanes.length === 1 && (key === "ArrowUp" || key === "ArrowDown")) {
      const lane = this.selected.lanes[0] + (key === "ArrowUp" ? -1 : 1);
      if (this.scene.units[lane]) this.move(this.selected, this.selected.start, lane);
    } else if (key === "+" || key === "=") this.zoom(1 / 1.5);
    else if (key === "-") this.zoom(1.5);
    else if (key === "0") this.view(this.mode.begin, this.length);
    else if (key === "m" && this.selected) this.mark(this.selected.start);
    else if (key === "Escape") { this.cursors = []; this.draw(); }
    else if (key.startsWith("Arrow")) this.step(key);
    else return;
    event.preventDefault();
  }
  step(key) {
    const job = this.selected || this.jobs[0];
    if (!job) return;
    let lane = job.lanes[0], row = this.byLane[lane], place = row.indexOf(job);
    if (key === "ArrowLeft" || key === "ArrowRight") { // through a lane, then on to the next one
      row = this.byLane.flat();
      place = (row.indexOf(job) + (key === "ArrowLeft" ? -1 : 1) + row.length) % row.length;
    } else {
      for (lane += key === "ArrowUp" ? -1 : 1; this.byLane[lane] && !this.byLane[lane].length;) lane += key === "ArrowUp" ? -1 : 1;
      row = this.byLane[lane];
      if (!row) return;
      place = row.reduce((best, other, n) => Math.abs(other.start - job.start) < Math.abs(row[best].start - job.start) ? n : best, 0);
    }
    const next = this.selected ? row[Math.max(0, Math.min(row.length - 1, place))] : job;
    if (next.start < this.from || next.start > this.to) this.pan(next.start - (this.from + this.to) / 2);
    this.select(next);
  }
  busyUnits() { // the share of units that are taken, from each instant of a change on
    const {begin, end: last} = this.mode, changes = new Map([[begin, 0]]), add = (time, by) => changes.set(time, (changes.get(time) || 0) + by);
    for (const job of this.jobs) {
      for (const [start, end] of job.parts) {
        for (const shift of this.shifts(end)) {
          const low = Math.max(begin, start + shift), high = Math.min(last, end + shift);
          if (low < high) { add(low, job.lanes.length); add(high, -job.lanes.length); }
        }
      }
    }
    let level = 0;
    return [...changes].sort((a, b) => a[0] - b[0]).map(([time, by]) => { level += by; return [time, level / this.scene.units.length]; });
  }

  tools() { // for those without a wheel; and what is shown as a picture or as a link
    const bar = document.createElement("div");
    bar.className = "zoom";
    const add = (text, label, act) => bar.append(Object.assign(document.createElement("button"), {type: "button", textContent: text, title: label, ariaLabel: label, onclick: act}));
    add("−", "zoom out", () => this.zoom(1.5)); add("+", "zoom in", () => this.zoom(1 / 1.5)); add("all", "show all", () => this.view(this.mode.begin, this.length));
    add("PNG", "save as PNG", () => this.canvas.toBlob(blob => this.save(blob, "png")));
    add("SVG", "save as SVG", () => this.save(new Blob([this.svg()], {type: "image/svg+xml"}), "svg"));
    add("link", "link to what is shown, in the address", () => { location.hash = this.link(); });
    return bar;
  }
  save(blob, kind) {
    const link = Object.assign(document.createElement("a"), {href: URL.createObjectURL(blob), download: `${this.scene.model} ${this.mode.name}.${kind}`});
    link.click(); URL.revokeObjectURL(link.href);
  }
  svg() {
    const pen = new SvgPen(this.context);
    this.whole = true; this.paint(pen); this.whole = false; this.draw();
    return pen.text(this.width, this.height);
  }
  link() {
    const {mode: {name: view}, from, to, selected} = this;
    return String(new URLSearchParams({view, from, to, ...(selected ? {task: selected.name, job: selected.index} : {})}));
  }
  go(address) { // back to what a link shows; false where it is of another table
    const told = new URLSearchParams(address.replace(/^#/, "")), [from, to] = [Number(told.get("from")), Number(told.get("to"))];
    if (!this.mode || told.get("view") !== this.mode.name || !(from < to)) return false;
    this.view(from, to - from);
    const job = this.jobs.find(job => job.name === told.get("task") && String(job.index) === told.get("job"));
    if (job) this.select(job);
    return true;
  }
}
function instant(time) { return `${+time.toFixed(6)} ms`; }

// As much of a canvas as the viewer uses, written as SVG.
class SvgPen {
  constructor(ruler) { this.ruler = ruler; this.parts = []; this.path = ""; this.dash = ""; this.globalAlpha = 1; this.lineWidth = 1; this.textAlign = "left"; }
  measureText(text) { return this.ruler.measureText(text); }
  add(shape, paint) { this.parts.push(`<${shape} ${paint} opacity="${this.globalAlpha}"/>`); }
  get line() { return `fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}" stroke-dasharray="${this.dash}"`; }
  fillRect(x, y, width, height) { this.add(`rect x="${x}" y="${y}" width="${width}" height="${height}"`, `fill="${this.fillStyle}"`); }
  strokeRect(x, y, width, height) { this.add(`rect x="${x}" y="${y}" width="${Math.max(0, width)}" height="${Math.max(0, height)}"`, this.line); }
  fillText(text, x, y) {
    const plain = text.replace(/[&<>]/g, sign => `&#${sign.charCodeAt(0)};`), anchor = this.textAlign === "center" ? "middle" : "start";
    this.parts.push(`<text x="${x}" y="${y}" fill="${this.fillStyle}" text-anchor="${anchor}" dominant-baseline="middle">${plain}</text>`);
  }
  beginPath() { this.path = ""; }
  moveTo(x, y) { this.path += `M${x} ${y}`; }
  lineTo(x, y) { this.path += `L${x} ${y}`; }
  arc(x, y, r) { this.path += `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`; }
  stroke() { if (this.path) this.add(`path d="${this.path}"`, this.line); }
  fill() { this.add(`path d="${this.path}"`, `fill="${this.fillStyle}"`); }
  setLineDash(lengths) { this.dash = lengths.join(" "); }
  save() {}
  rect(x, y, width, height) { this.box = `<rect x="${x}" y="${y}" width="${width}" height="${height}"/>`; }
  clip() { this.parts.push(`<clipPath id="plot">${this.box}</clipPath><g clip-path="url(#plot)">`); }
  restore() { this.parts.push("</g>"); }
  text(width, height) { return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" font="${FONT}" style="font:${FONT}">${this.parts.join("\n")}</svg>\n`; }
}

window.Viewer = Viewer;

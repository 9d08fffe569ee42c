"use strict";
const command = JSON.parse(document.getElementById("words").textContent);
const marks = [];
const text = document.getElementById("command");
const views = [...document.querySelectorAll(".view")];

function draw() {
  let line = command, current = null;
  for (const view of views) view.querySelector("svg").replaceChildren();
  for (const mark of marks) {
    if (mark.view !== current) { line += " --view-index " + mark.view; current = mark.view; }
    line += (mark.remove ? " --remove-" : " --") + (mark.p.length === 2 ? "click " : "box ") + mark.p.join(" ");
    show(mark);
  }
  text.value = marks.length ? line : command + "  (click in a view)";
}

function show(mark) {
  const view = views.find(v => +v.dataset.view === mark.view);
  const box = mark.p.length === 4;
  const shape = document.createElementNS("http://www.w3.org/2000/svg", box ? "rect" : "circle");
  const set = box
    ? { x: mark.p[0], y: mark.p[1], width: mark.p[2] - mark.p[0], height: mark.p[3] - mark.p[1], fill: "none" }
    : { cx: mark.p[0] + 0.5, cy: mark.p[1] + 0.5, r: +view.dataset.width / 100 };
  set.stroke = mark.remove ? "#ff4030" : "#30e060";
  set["stroke-width"] = +view.dataset.width / 250;
  if (!box) set.fill = mark.remove ? "#ff403080" : "#30e06080";
  for (const name in set) shape.setAttribute(name, set[name]);
  view.querySelector("svg").append(shape);
}

function pixel(view, event) {
  const frame = view.getBoundingClientRect(), w = +view.dataset.width, h = +view.dataset.height;
  const x = Math.floor((event.clientX - frame.left) / frame.width * w);
  const y = Math.floor((event.clientY - frame.top) / frame.height * h);
  return [Math.min(Math.max(x, 0), w - 1), Math.min(Math.max(y, 0), h - 1)];
}

for (const view of views) {
  let start = null;
  const place = view.parentElement.querySelector("span");
  view.addEventListener("pointerdown", event => {
    start = pixel(view, event);
    view.setPointerCapture(event.pointerId);
  });
  view.addEventListener("contextmenu", event => event.preventDefault());  // which Ctrl and a click open on a Mac
  view.addEventListener("pointermove", event => { place.textContent = pixel(view, event).join(" "); });
  view.addEventListener("pointerup", event => {
    if (!start) return;
    const end = pixel(view, event), ticked = document.getElementById("remove").checked;
    const remove = event.ctrlKey || event.metaKey || (ticked && !event.shiftKey);
    const far = Math.max(Math.abs(end[0] - start[0]), Math.abs(end[1] - start[1])) > +view.dataset.width / 100;
    const low = [Math.min(start[0], end[0]), Math.min(start[1], end[1])];
    const high = [Math.max(start[0], end[0]) + 1, Math.max(start[1], end[1]) + 1];
    marks.push({ view: +view.dataset.view, p: far ? [...low, ...high] : start, remove });
    start = null;
    draw();
  });
}
document.getElementById("undo").onclick = () => { marks.pop(); draw(); };
document.getElementById("clear").onclick = () => { marks.length = 0; draw(); };
document.getElementById("copy").onclick = () => {
  text.select();
  if (navigator.clipboard) navigator.clipboard.writeText(text.value); else document.execCommand("copy");
};
draw();

"use strict";
const command = JSON.parse(document.getElementById("words").textContent);
const cards = [...document.querySelectorAll("figure")];
const line = document.getElementById("command");
const quoted = word => /^[\w=+.-]+$/.test(word) ? word : "'" + word.replaceAll("'", "'\\''") + "'";

function draw() {
  const keep = [], merge = [], split = [], names = [];
  let usual = true;
  for (const card of cards) {
    const id = card.dataset.id, tick = card.querySelector(".keep");
    const other = card.querySelector(".merge").value.trim(), name = card.querySelector(".name").value.trim();
    card.classList.toggle("off", !tick.checked);
    if (tick.checked !== (tick.dataset.sure === "1")) usual = false;
    if (tick.checked) keep.push(id);
    if (/^\d+$/.test(other) && other !== id) merge.push(id + "+" + other);
    if (card.querySelector(".split").checked) split.push(id);
    if (name) names.push(quoted(id + "=" + name));
  }
  line.value = [command, ...(usual ? [] : ["--keep", ...keep]), ...(merge.length ? ["--merge", ...merge] : []),
    ...(split.length ? ["--split-objects", ...split] : []), ...(names.length ? ["--names", ...names] : [])].join(" ");
}

function tickAll(on) {
  for (const card of cards) card.querySelector(".keep").checked = on;
  draw();
}

document.addEventListener("input", draw);
document.getElementById("all").onclick = () => tickAll(true);
document.getElementById("none").onclick = () => tickAll(false);
document.getElementById("copy").onclick = () => {
  line.select();
  if (navigator.clipboard) navigator.clipboard.writeText(line.value); else document.execCommand("copy");
};
draw();

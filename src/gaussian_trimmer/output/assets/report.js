"use strict";
// Sliders: each shows the picture on the left up to where its range stands.
for (const pair of document.querySelectorAll(".pair")) {
  const slider = pair.querySelector("input");
  slider.addEventListener("input", () => pair.style.setProperty("--at", slider.value));
}
for (const box of document.querySelectorAll(".comparison")) {
  for (const choice of box.querySelectorAll("fieldset input")) {
    choice.addEventListener("change", () => compare(box, choice));
  }
}

function compare(box, choice) {
  const { left, right } = choice.dataset;
  for (const image of box.querySelectorAll(".pair img")) {
    const layer = image.dataset.layer;
    image.className = layer === left ? "left" : layer === right ? "right" : "";
    image.hidden = !image.className;
  }
  for (const name of box.querySelectorAll(".name")) {
    name.textContent = name.classList.contains("left") ? left : right;
  }
  for (const note of box.querySelectorAll(".note")) note.hidden = note.dataset.pairing !== choice.value;
}

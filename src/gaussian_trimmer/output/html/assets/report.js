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

// An object turning: one picture for each angle.
for (const box of document.querySelectorAll(".turning")) turnable(box);

function turnable(box) {
  const { frames, yaws, verdicts } = JSON.parse(box.querySelector("script").textContent);
  const table = box.querySelector(".turntable"), frame = table.querySelector("canvas");
  const angle = box.querySelector(".angle"), play = box.querySelector(".play");
  const side = box.querySelector("output"), needle = box.querySelector(".needle");
  const backdrops = box.querySelectorAll(".backdrop");
  const count = yaws.length, turnSeconds = 9, kept = {};
  let shown = Object.keys(frames)[0], timer = 0, wanted = null;

  function keep(name) { // Decoded once.
    kept[name] ??= frames[name].map(source => {
      const image = new Image();
      image.src = source;
      return image;
    });
  }

  // A picture holds the colours over black and, below them, the opacity.
  const canvas = frame.getContext("2d"), size = frame.width;
  const scratch = document.createElement("canvas");
  scratch.width = size;
  scratch.height = 2 * size;
  const reader = scratch.getContext("2d", { willReadFrequently: true });

  function draw(image) {
    reader.drawImage(image, 0, 0);
    const colours = reader.getImageData(0, 0, size, size), data = colours.data;
    const opacity = reader.getImageData(0, size, size, size).data;
    for (let i = 0; i < data.length; i += 4) {
      const alpha = opacity[i] < 6 ? 0 : opacity[i]; // what is less is the noise of the compression
      for (let k = 0; k < 3; k++) data[i + k] = alpha ? Math.min(255, data[i + k] * 255 / alpha) : 0;
      data[i + 3] = alpha;
    }
    canvas.putImageData(colours, 0, 0);
  }

  async function show(number) {
    const i = ((Math.round(number) % count) + count) % count, image = kept[shown][i];
    angle.value = i;
    table.classList.toggle("unchecked", verdicts[i] !== "");
    side.textContent = yaws[i] + " degrees: " + (verdicts[i] ? "not checked, " + verdicts[i] : "checked");
    angle.setAttribute("aria-valuetext", side.textContent);
    if (needle) needle.setAttribute("transform", "rotate(" + (90 - yaws[i]) + " 100 100)");
    wanted = image;
    await image.decode();
    if (wanted !== image) return;
    draw(image);
    frame.dataset.shown = i;
  }

  function run(on) {
    clearInterval(timer);
    timer = on ? setInterval(() => show(+angle.value + 1), 1000 * turnSeconds / count) : 0;
    play.setAttribute("aria-pressed", String(on));
    play.textContent = on ? "stop" : "turn";
  }

  angle.addEventListener("input", () => { run(false); show(+angle.value); });
  play.addEventListener("click", () => run(!timer));
  for (const choice of box.querySelectorAll(".shown")) {
    choice.addEventListener("change", () => { shown = choice.value; keep(shown); show(+angle.value); });
  }
  for (const choice of backdrops) {
    choice.addEventListener("change", () => {
      for (const other of backdrops) table.classList.remove(other.value);
      table.classList.add(choice.value);
    });
  }
  let from = null;
  table.addEventListener("pointerdown", event => {
    from = { x: event.clientX, at: +angle.value };
    table.setPointerCapture(event.pointerId);
    run(false);
  });
  table.addEventListener("pointermove", event => {
    if (from) show(from.at - (event.clientX - from.x) / table.clientWidth * count);
  });
  for (const end of ["pointerup", "pointercancel"]) table.addEventListener(end, () => { from = null; });
  keep(shown);
  show(0);
}

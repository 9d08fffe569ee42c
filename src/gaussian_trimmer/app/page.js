// What the page itself does: it draws the brush's ring, the lasso and the box while they are used, tells the program what
// was drawn, shows what goes on in a line over the picture, compares two states by a line to drag, and takes files that
// are dropped. Everything is said through one hidden text field.
(() => {
  const CHANNEL = "gesture:";
  const FREE_PIXELS = 12; // a press that moves less is a click
  const CLOSE_PIXELS = 12; // so near its first corner, a polygon closes
  const TWICE_MILLISECONDS = 400; // a second click at the same place within this time is the first one again
  const MOST_PLACES = 1500;
  document.title = "GaussianTrimmer";
  window.gaussianTrimmerPage?.abort();
  const page = (window.gaussianTrimmerPage = new AbortController());
  const listen = (type, act) => window.addEventListener(type, act, { capture: true, signal: page.signal });

  const SVG = "http://www.w3.org/2000/svg";
  const overlay = document.createElementNS(SVG, "svg");
  overlay.setAttribute("style", "position:fixed;inset:0;width:100vw;height:100vh;pointer-events:none;z-index:50");
  overlay.id = "gesture-overlay";
  const shape = (name, attributes) => {
    const element = overlay.appendChild(document.createElementNS(SVG, name));
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const line = { fill: "none", "stroke-linejoin": "round", "stroke-linecap": "round" };
  const swath = shape("polyline", { ...line, stroke: "#fff", "stroke-opacity": 0.3 });
  const outer = shape("polygon", { fill: "#fff", "fill-opacity": 0.08, stroke: "#000", "stroke-width": 3 });
  const inner = shape("polygon", { fill: "none", stroke: "#fff", "stroke-width": 1.5, "stroke-dasharray": "5 3" });
  const rings = [
    shape("circle", { fill: "none", stroke: "#000", "stroke-width": 3, "stroke-opacity": 0.6 }),
    shape("circle", { fill: "none", stroke: "#fff", "stroke-width": 1.5 }),
  ];
  document.getElementById("gesture-overlay")?.remove();
  document.body.append(overlay);
  page.signal.addEventListener("abort", () => overlay.remove());

  let drawn = []; // places in the window, [x, y]
  let active = null; // the tool whose drag is going on, or "polygon" while it has corners
  let press = null;
  let last = { time: 0, x: 0, y: 0 };
  const state = () => document.querySelector("[data-tool]")?.dataset ?? { tool: "Look", radius: "0" };
  const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const field = () => [...document.querySelectorAll("input")].find((input) => input.value.startsWith(CHANNEL));

  function say(tool, places, event) {
    const input = field();
    const canvas = document.querySelector("canvas").getBoundingClientRect();
    if (!input) return;
    const step = Math.max(1, Math.ceil(places.length / MOST_PLACES));
    const chosen = places.filter((_, i) => i % step === 0 || i === places.length - 1);
    const shares = chosen.map(([x, y]) => [(x - canvas.left) / canvas.width, (y - canvas.top) / canvas.height]);
    const command = event.ctrlKey || event.metaKey;
    const keys = command && event.shiftKey ? "both" : command ? "ctrl" : event.shiftKey ? "shift" : "";
    const text = CHANNEL + JSON.stringify({ tool, places: shares, keys, time: performance.now() });
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, text);
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }

  // The status line, over the picture at its lower left: what is going on, with a bar and Cancel, or what was done.
  const styled = (parent, name, style) => {
    const element = parent.appendChild(document.createElement(name));
    element.setAttribute("style", style);
    return element;
  };
  const BUTTON = "pointer-events:auto;cursor:pointer;font:inherit;color:#fff;background:#444;border:0;border-radius:4px;";
  const status = styled(document.body, "div", "");
  status.setAttribute("role", "status");
  const cancel = styled(status, "button", ""); // it stays the same at each stage, so that a press is not lost
  cancel.textContent = "Cancel";
  cancel.onclick = () => say("Cancel", [], {});
  const sentence = styled(status, "span", "");
  const bar = styled(status, "div", "");
  page.signal.addEventListener("abort", () => status.remove());

  function showStatus() {
    const { said, share, wrong } = state();
    const box = document.querySelector("canvas")?.getBoundingClientRect();
    const shown = [said, share, wrong, box?.left, box?.right].join("|");
    if (!said || !box || status.shown === shown) return;
    status.shown = shown;
    const look =
      `position:fixed;z-index:40;pointer-events:none;bottom:12px;left:${box.left + 12}px;box-sizing:border-box;` +
      `max-width:min(36rem,${box.width - 24}px);padding:8px 12px;border-radius:6px;font:13px/1.4 sans-serif;color:#fff;` +
      `overflow-wrap:anywhere;background:rgba(32,32,32,.88);border-left:4px solid `;
    const display = `display:${share === undefined ? "none" : "inline-block"};`;
    status.setAttribute("style", look + (wrong ? "#e03131" : share ? "#1c7ed6" : "#2f9e44"));
    cancel.setAttribute("style", `${BUTTON}${display}background:#c92a2a;margin-right:10px;padding:1px 8px`);
    bar.setAttribute("style", `${display}position:absolute;left:0;bottom:0;height:3px;background:#1c7ed6;width:${100 * share}%`);
    sentence.replaceChildren();
    said.split(/'([^']*[/\\][^']*)'/).forEach((text, i) => {
      if (i % 2 === 0) return sentence.append(text);
      const path = styled(sentence, "button", `${BUTTON}padding:0 4px`);
      [path.textContent, path.title] = [text, "Copy this path"];
      path.onclick = () => navigator.clipboard?.writeText(text).then(() => (path.title = "Copied"));
    });
  }

  // Comparing: a picture of what was shown lies over one side of the line, and the 3D view shows the other state.
  const wipe = { line: shape("line", { stroke: "#fff", "stroke-width": 2 }), names: [], share: 0.5 };
  wipe.grip = shape("circle", { r: 11, fill: "#fff", stroke: "#000", "stroke-opacity": 0.4 });
  for (const anchor of ["end", "start"]) {
    const look = "font:600 14px sans-serif;paint-order:stroke;stroke:#000;stroke-width:4px;stroke-linejoin:round";
    wipe.names.push(shape("text", { "text-anchor": anchor, fill: "#fff", style: look }));
  }

  function drawWipe() {
    const { still, sides } = state();
    const box = document.querySelector("canvas")?.getBoundingClientRect();
    const shown = wipe.still && box ? "inline" : "none";
    for (const element of [wipe.line, wipe.grip, ...wipe.names]) element.style.display = shown;
    if (shown === "none") return;
    const x = box.left + wipe.share * box.width;
    for (const [end, y] of [[1, box.top], [2, box.bottom]]) {
      wipe.line.setAttribute(`x${end}`, x), wipe.line.setAttribute(`y${end}`, y);
    }
    wipe.grip.setAttribute("cx", x), wipe.grip.setAttribute("cy", (box.top + box.bottom) / 2);
    wipe.names.forEach((name, i) => {
      name.textContent = sides?.split("|")[i] ?? "";
      name.setAttribute("x", x + (i ? 12 : -12)), name.setAttribute("y", box.top + 28);
    });
    const cut = still === "left" ? `inset(0 ${100 * (1 - wipe.share)}% 0 0)` : `inset(0 0 0 ${100 * wipe.share}%)`;
    wipe.still.setAttribute(
      "style",
      `position:fixed;pointer-events:none;z-index:1;left:${box.left}px;top:${box.top}px;` +
        `width:${box.width}px;height:${box.height}px;clip-path:${cut}`,
    );
  }

  // Take the picture when the program asks for it, and away when it does no more.
  function followWipe() {
    const wanted = document.hidden ? undefined : state().number;
    if (wanted === wipe.number) return;
    wipe.still?.remove();
    [wipe.still, wipe.number] = [null, wanted];
    if (wanted) {
      const canvas = [...document.querySelectorAll("canvas")].find((each) => each.width);
      const picture = document.createElement("canvas");
      [picture.width, picture.height] = [canvas.width, canvas.height];
      picture.getContext("2d").drawImage(canvas, 0, 0);
      wipe.still = picture;
      wipe.share = 0.5;
      canvas.after(picture);
      say("Still taken", [], {});
    }
    drawWipe();
  }
  const follow = () => (followWipe(), showStatus());
  const watch = new MutationObserver(follow);
  const attributeFilter = ["data-number", "data-said", "data-share", "data-wrong"];
  watch.observe(document.body, { subtree: true, childList: true, attributes: true, attributeFilter });
  page.signal.addEventListener("abort", () => (watch.disconnect(), wipe.still?.remove()));

  function dragWipe(event) {
    const box = document.querySelector("canvas").getBoundingClientRect();
    wipe.share = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    event.stopImmediatePropagation(); // the drag is the line's, and does not turn the view
    event.preventDefault();
    drawWipe();
  }

  function draw(at) {
    const { tool, radius } = state();
    const corners = tool === "Box" && active ? boxOf(drawn) : active === "Polygon" && at ? [...drawn, at] : drawn;
    const text = corners.map((place) => place.join(",")).join(" ");
    for (const outline of [outer, inner]) outline.setAttribute("points", tool === "Brush" ? "" : text);
    swath.setAttribute("points", tool === "Brush" ? text : "");
    swath.setAttribute("stroke-width", 2 * radius);
    for (const ring of rings) {
      ring.setAttribute("r", tool === "Brush" && at ? radius : 0);
      if (at) ring.setAttribute("cx", at[0]), ring.setAttribute("cy", at[1]);
    }
  }
  const boxOf = ([[x0, y0], [x1, y1]]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];

  function finish(tool, event) {
    if (active && drawn.length) say(tool, drawn, event);
    (drawn = []), (active = null);
    draw(null);
  }

  listen("pointerdown", (event) => {
    const { tool } = state();
    if (event.button !== 0 || event.altKey || !(event.target instanceof HTMLCanvasElement)) return;
    document.activeElement?.blur();
    if (wipe.still) return (wipe.dragged = true), dragWipe(event);
    const at = [event.clientX, event.clientY];
    press = { at, moved: 0 };
    if (!["Box", "Lasso", "Polygon", "Brush"].includes(tool)) return;
    event.stopImmediatePropagation(); // the drag is the tool's, and does not turn the view
    event.preventDefault();
    if (tool === "Polygon") {
      if (active && drawn.length > 2 && apart(at, drawn[0]) < CLOSE_PIXELS) return finish(tool, event);
      if (!drawn.length || apart(at, drawn.at(-1)) > 2) drawn.push(at);
    } else drawn = tool === "Box" ? [at, at] : [at];
    active = tool;
    draw(at);
  });

  listen("pointermove", (event) => {
    if (wipe.dragged && wipe.still) return dragWipe(event);
    const { tool } = state();
    const at = [event.clientX, event.clientY];
    if (press) press.moved = Math.max(press.moved, apart(at, press.at));
    if (active && active !== tool) (drawn = []), (active = null);
    if (active === "Box") drawn[1] = at;
    else if (active && active !== "Polygon" && apart(at, drawn.at(-1)) > 1.5) drawn.push(at);
    if (active && active !== "Polygon") event.stopImmediatePropagation();
    draw(event.target instanceof HTMLCanvasElement || active ? at : null);
  });

  listen("pointerup", (event) => {
    if (wipe.dragged) return (wipe.dragged = false), event.stopImmediatePropagation();
    const { tool } = state();
    const at = [event.clientX, event.clientY];
    const still = press && press.moved < FREE_PIXELS && !event.altKey;
    const clicked = press && event.target instanceof HTMLCanvasElement;
    press = null;
    if (active && active !== "Polygon") {
      event.stopImmediatePropagation();
      if (still && tool !== "Brush") drawn = []; // neither a box nor a lasso
      return finish(tool, event);
    }
    if (!clicked || !still || !["Click", "Up by 3 points"].includes(tool)) return;
    const again = event.timeStamp - last.time < TWICE_MILLISECONDS && apart(at, [last.x, last.y]) < FREE_PIXELS;
    last = { time: event.timeStamp, x: at[0], y: at[1] };
    if (!again) say(tool, [at], event);
  });

  listen("dblclick", (event) => active === "Polygon" && drawn.length > 2 && finish("Polygon", event));
  listen("resize", () => (drawWipe(), showStatus()));
  listen("contextmenu", (event) => event.target instanceof HTMLCanvasElement && event.preventDefault());

  const cancelOfQuestion = () =>
    [...document.querySelectorAll('[role="dialog"] button')].find((button) => button.textContent.trim() === "Cancel");

  listen("keydown", (event) => {
    const cancel = cancelOfQuestion();
    if (cancel && event.key === "Escape") cancel.click();
    if (cancel && !["Tab", "Enter", " "].includes(event.key)) return event.stopImmediatePropagation(); // it is for the question
    if (event.target.matches?.("input, textarea")) {
      const leaves = event.key === "Escape" || (event.key === "Enter" && event.target.matches("input"));
      if (leaves && !event.target.closest('[role="dialog"]')) event.target.blur();
      return;
    }
    if (active && event.key === "Escape") (drawn = []), (active = null);
    else if (active === "Polygon" && event.key === "Backspace") drawn.pop();
    else if (active === "Polygon" && event.key === "Enter" && drawn.length > 2) return finish("Polygon", event);
    else if (event.key === "[" || event.key === "]") return say(event.key, [], event);
    draw(null);
  });
  drawWipe();
  showStatus();

  const upload = () => document.querySelector('input[type="file"]');
  listen("dragover", (event) => event.dataTransfer.types.includes("Files") && event.preventDefault());
  listen("drop", (event) => {
    if (!event.dataTransfer.files.length || !upload()) return;
    event.preventDefault();
    upload().files = event.dataTransfer.files;
    upload().dispatchEvent(new Event("change", { bubbles: true }));
  });
})();

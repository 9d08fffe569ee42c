// What the page does in the 3D view: it draws the brush's ring, the lasso and the box while they are used, tells the
// program what was drawn and which keys were pressed, and takes files that are dropped. The program tells how everything
// is by a hidden element, and is told by a hidden field.
(() => {
  const CHANNEL = "gesture:";
  const BRUSHES = ["Brush", "Sphere"];
  const FREE_PIXELS = 12; // a press that moves less is a click
  const CLOSE_PIXELS = 12; // so near its first corner, a polygon closes
  const TWICE_MILLISECONDS = 400; // a second click at the same place within this time is the first one again
  const MOST_PLACES = 1500;
  const REPEATED_MILLISECONDS = 400; // what was said is said again for so long, since not every text arrives
  document.title = "GaussianTrimmer";
  window.gaussianTrimmerPage?.page.abort();
  const page = new AbortController();
  const listen = (type, act) => window.addEventListener(type, act, { capture: true, signal: page.signal });

  const SVG = "http://www.w3.org/2000/svg";
  const overlay = document.createElementNS(SVG, "svg");
  overlay.setAttribute("style", "position:fixed;inset:0;width:100vw;height:100vh;pointer-events:none;z-index:50;filter:drop-shadow(0 0 1px #000)");
  overlay.id = "gesture-overlay";
  const shape = (name, attributes) => {
    const element = overlay.appendChild(document.createElementNS(SVG, name));
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const line = { fill: "none", "stroke-linejoin": "round", "stroke-linecap": "round" };
  const swath = shape("polyline", { ...line, stroke: "#fff", "stroke-opacity": 0.3 });
  const dashed = { stroke: "#fff", "stroke-width": 1.5, "stroke-dasharray": "5 3" };
  const outline = shape("polygon", { ...dashed, fill: "#fff", "fill-opacity": 0.08 });
  const ring = shape("circle", { ...dashed, fill: "none", "stroke-dasharray": "none" });
  // Beside the pointer: whether what is marked is added, removed or kept.
  const SIGNS = { add: "+", remove: "\u2212", intersect: "\u2229", Add: "+", Remove: "\u2212", "Keep only": "\u2229", Replace: "=" };
  const sign = shape("text", { fill: "#fff", style: "font:600 18px sans-serif;paint-order:stroke;stroke:#000;stroke-width:3px" });
  document.getElementById("gesture-overlay")?.remove();
  document.body.append(overlay);
  page.signal.addEventListener("abort", () => overlay.remove());

  let drawn = []; // places in the window, [x, y]
  let active = null; // the tool whose drag is going on, or "polygon" while it has corners
  let press = null;
  let last = { time: 0, x: 0, y: 0 };
  const heldKeys = new Map(); // from a key to the action that ends when it is let go
  let state = { tool: "Look", radius: 0, keys: {} };
  const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const field = () => [...document.querySelectorAll("input")].find((input) => input.value.startsWith(CHANNEL));

  let said = [];
  function say(what) {
    const input = field();
    if (!input) return;
    const now = performance.now();
    window.gaussianTrimmerSaid = (window.gaussianTrimmerSaid ?? 0) + 1;
    said = said.filter((each) => now - each.time < REPEATED_MILLISECONDS);
    said.push({ ...what, time: now, number: window.gaussianTrimmerSaid });
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, CHANNEL + JSON.stringify(said));
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }

  function sayDrawn(tool, places, event) {
    const canvas = document.querySelector("canvas").getBoundingClientRect();
    const step = Math.max(1, Math.ceil(places.length / MOST_PLACES));
    const chosen = places.filter((_, i) => i % step === 0 || i === places.length - 1);
    const shares = chosen.map(([x, y]) => [(x - canvas.left) / canvas.width, (y - canvas.top) / canvas.height]);
    say({ tool, places: shares, effect: effectOf(event) });
  }
  const effectOf = ({ ctrlKey, metaKey, shiftKey }) =>
    ctrlKey || metaKey ? (shiftKey ? "intersect" : "remove") : shiftKey ? "add" : "";

  // Follow what the program tells, and where the picture is.
  let told, seen;
  const surface = (window.gaussianTrimmerPage = { page, say, changed: () => ((told = undefined), follow()), draw: () => {} });
  const sizes = new ResizeObserver(() => surface.changed());
  function follow() {
    const text = document.querySelector("[data-gaussian-trimmer]")?.dataset.gaussianTrimmer;
    const canvas = document.querySelector("canvas");
    if (!text || !canvas || (text === told && canvas === seen)) return;
    if (canvas !== seen) sizes.disconnect(), sizes.observe(canvas);
    [told, seen] = [text, canvas];
    state = JSON.parse(text);
    state.tool = state.controls.Tool.value;
    state.radius = state.controls["Brush radius"].value;
    surface.draw(state, canvas.getBoundingClientRect());
    draw(null);
  }
  const watch = new MutationObserver(follow);
  watch.observe(document.body, { subtree: true, childList: true, attributes: true, attributeFilter: ["data-gaussian-trimmer"] });
  const looking = setInterval(() => { // viser lets nobody press its controls while it is not connected
    const lost = getComputedStyle(field() ?? document.body).pointerEvents === "none";
    document.querySelectorAll("#gt-picture, #gt-panel").forEach((part) => part.classList.toggle("lost", lost));
  }, 1000);
  page.signal.addEventListener("abort", () => (watch.disconnect(), sizes.disconnect(), clearInterval(looking)));

  function draw(at) {
    const { tool, radius } = state;
    const brush = BRUSHES.includes(tool);
    sign.textContent = "";
    const corners = tool === "Box" && active ? boxOf(drawn) : active === "Polygon" && at ? [...drawn, at] : drawn;
    const text = corners.map((place) => place.join(",")).join(" ");
    outline.setAttribute("points", brush ? "" : text);
    swath.setAttribute("points", brush ? text : "");
    swath.setAttribute("stroke-width", 2 * radius);
    ring.setAttribute("r", brush && at ? radius : 0);
    if (at) ring.setAttribute("cx", at[0]), ring.setAttribute("cy", at[1]);
  }
  const boxOf = ([[x0, y0], [x1, y1]]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];

  function finish(tool, event) {
    if (active && drawn.length) sayDrawn(tool, drawn, event);
    (drawn = []), (active = null);
    draw(null);
  }

  listen("pointerdown", (event) => {
    const { tool } = state;
    if (event.button !== 0 || event.altKey || !(event.target instanceof HTMLCanvasElement)) return;
    document.activeElement?.blur();
    const at = [event.clientX, event.clientY];
    press = { at, moved: 0 };
    if (!["Box", "Lasso", "Polygon", ...BRUSHES].includes(tool)) return;
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
    const { tool } = state;
    const at = [event.clientX, event.clientY];
    if (press) press.moved = Math.max(press.moved, apart(at, press.at));
    if (active && active !== tool) (drawn = []), (active = null);
    if (active === "Box") drawn[1] = at;
    else if (active && active !== "Polygon" && apart(at, drawn.at(-1)) > 1.5) drawn.push(at);
    if (active && active !== "Polygon") event.stopImmediatePropagation();
    const over = event.target instanceof HTMLCanvasElement || active;
    draw(over ? at : null);
    if (tool === "Look" || !over || event.altKey) return;
    sign.textContent = SIGNS[effectOf(event) || state.controls.Mode.value];
    sign.setAttribute("x", at[0] + 14), sign.setAttribute("y", at[1] - 10);
  });

  listen("pointerup", (event) => {
    const { tool } = state;
    const at = [event.clientX, event.clientY];
    const still = press && press.moved < FREE_PIXELS && !event.altKey;
    const clicked = press && event.target instanceof HTMLCanvasElement;
    press = null;
    if (active && active !== "Polygon") {
      event.stopImmediatePropagation();
      if (still && !BRUSHES.includes(tool)) drawn = []; // neither a box nor a lasso
      return finish(tool, event);
    }
    if (!clicked || !still || !["Click", "Up by 3 points"].includes(tool)) return;
    const again = event.timeStamp - last.time < TWICE_MILLISECONDS && apart(at, [last.x, last.y]) < FREE_PIXELS;
    last = { time: event.timeStamp, x: at[0], y: at[1] };
    if (!again) sayDrawn(tool, [at], event);
  });

  listen("resize", surface.changed);
  listen("contextmenu", (event) => event.target instanceof HTMLCanvasElement && event.preventDefault());

  listen("keydown", (event) => {
    if (event.target.matches?.('input:not([type="checkbox"]), textarea, select')) {
      if (event.key === "Escape" || (event.key === "Enter" && event.target.matches("input"))) event.target.blur();
      return;
    }
    if (active && event.key === "Escape") (drawn = []), (active = null);
    else if (active === "Polygon" && event.key === "Backspace") return drawn.pop(), draw(null);
    else if (active === "Polygon" && event.key === "Enter" && drawn.length > 2) return finish("Polygon", event);
    draw(null);
    const [name, , ends] = bound(event);
    if (!name) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (ends && event.repeat) return;
    if (ends) heldKeys.set(event.code, name);
    say({ do: name });
  });
  const letGo = (code) => heldKeys.has(code) && (say({ do: heldKeys.get(code), ends: true }), heldKeys.delete(code));
  listen("keyup", (event) => letGo(event.code));
  listen("blur", () => [...heldKeys.keys()].forEach(letGo));

  // The action that a key is bound to: its name, the key, and whether it lasts while the key is held.
  const NAMES = { " ": "Space", Escape: "Esc", Backspace: "Delete" };
  function bound(event) {
    const held = [(event.ctrlKey || event.metaKey) && "Ctrl", event.shiftKey && /^.$/.test(event.key) && "Shift"].filter(Boolean);
    const key = [...held, NAMES[event.key] ?? (event.key.length === 1 ? event.key.toUpperCase() : event.key)].join("+");
    const found = event.altKey ? undefined : Object.entries(state.keys).find(([, [keys]]) => keys.split(", ").includes(key));
    return found ? [found[0], ...found[1]] : [];
  }

  const upload = () => document.querySelector('input[type="file"]');
  const mark = (over) => document.getElementById("gt-picture")?.classList.toggle("over", over);
  listen("dragover", (event) => event.dataTransfer.types.includes("Files") && (event.preventDefault(), mark(true)));
  listen("dragleave", (event) => event.relatedTarget || mark(false));
  listen("drop", (event) => {
    mark(false);
    if (!event.dataTransfer.files.length || !upload()) return;
    event.preventDefault();
    upload().files = event.dataTransfer.files;
    upload().dispatchEvent(new Event("change", { bubbles: true }));
  });
})();

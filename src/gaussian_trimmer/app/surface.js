// The page's own surface: a toolbar, the tool's settings and a status line over the picture, what is seen at its upper
// right, a place to drop files, and the panel beside it. `page.js` says how everything is, and tells what is done here.
(() => {
  const { page, say, changed } = window.gaussianTrimmerPage;
  const ICONS = {
    Look: "M2 10s3-5 8-5 8 5 8 5-3 5-8 5-8-5-8-5zM10 8a2 2 0 1 0 0 4 2 2 0 0 0 0-4z",
    Click: "M4 3l12 7-5 1 3 5-2 1-3-5-4 4z",
    Box: "M3 5h3M8 5h4M14 5h3v3M17 10v2M17 14v1h-3M12 15H8M6 15H3v-3M3 10V8",
    Lasso: "M10 4c4 0 7 2 7 4.500s-3 4.500-7 4.500-7-2-7-4.500S6 4 10 4zM6 12.500c-1.500 1-1 3 1 5",
    Polygon: "M4 8l7-5 6 6-3 8H6z",
    Brush: "M17 3l-8 8M9 11c-2 0-3 1-3 3 0 1-1 2-3 2 2 2 8 2 8-2 0-1-1-3-2-3z",
    Sphere: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM3 10c0 4 14 4 14 0",
    "3D box": "M10 2l7 4v8l-7 4-7-4V6zM3 6l7 4 7-4M10 10v8",
    Grow: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM10 7v6M7 10h6",
    Shrink: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM7 10h6",
    Invert: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM10 3v14M10 6l5 0M10 10h7M10 14h5",
    Undo: "M7 4L3 8l4 4M3 8h9a4 4 0 0 1 0 8H8",
    Redo: "M13 4l4 4-4 4M17 8H8a4 4 0 0 0 0 8h4",
    locked: "M5 9h10v8H5zM7 9V6a3 3 0 0 1 6 0v3",
    delete: "M4 6h12M8 6V4h4v2M6 6l1 11h6l1-11",
  };
  ICONS.hidden = ICONS.Look;
  const DRAWN = ["Box", "Lasso", "Polygon", "Brush"];
  const SETTINGS = {
    Mode: ["Click", ...DRAWN, "Sphere", "3D box"], Reach: DRAWN, "Take by": DRAWN, "Brush radius": ["Brush", "Sphere"],
    Tolerance: ["Click"],
  };
  const CHANGES = { "#14b464": "added", "#de3c28": "removed", "#3c82e6": "cut at the outline", "#f5e13c": "made up" };
  const BACKDROPS = { Black: "#000", Grey: "#777", White: "#fff", Checker: "repeating-conic-gradient(#969696 0 25%, #696969 0 50%) 0/10px 10px" };
  const PANEL = [
    ["", [["!Cut out"], ["Find objects", "New object", "Show all"], [list]]],
    ["Save", [
      ["Download", "Download: Object", "Download: Scene without it", "Download: Everything", "Download: Web page"],
      ["=Format"], ["=For"], ["=Folder"], ["=Earlier results"], ["Save in this folder"],
      ["Cut out and save all objects"], ["=The same by command"],
    ]],
    ["File", [
      [chooser], ["=Scene"], ["=Cameras"], ["Open", "Apply cameras to this scene"], ["=Selection"],
      ["Replace the marks by this file"], ["Download the project"], [up], ["=Up is"], ["Up by three clicks on the ground"],
    ]],
    ["Options", [
      ["=Take in what is attached"], ["=Fit the outline"], ["=Clean the background"], ["=Continue the surface"],
      ["=Virtual cameras"],
    ]],
    ["Keys", [[help]]],
  ];
  const HELD = [
    ["Shift, Ctrl, both", "add, remove, keep only, regardless of the mode"], ["Alt", "turn the view while a tool is chosen"],
    ["W A S D, arrows", "move and turn"], ["Enter, Esc", "leave a field"],
  ];

  const make = (parent, name, facts = {}, ...inside) => {
    const element = Object.assign(document.createElement(name), facts);
    element.append(...inside);
    parent?.append(element);
    return element;
  };
  const follow = []; // functions of the state that bring an element up to it
  const follows = (element, act) => (follow.push((state) => act(element, state)), element);
  const icon = (name) => {
    const holder = make(null, "span");
    holder.innerHTML = `<svg viewBox="0 0 20 20"><path d="${ICONS[name]}"/></svg>`;
    return holder.firstChild;
  };
  const keyOf = (state, name) => (state.keys[name] ? ` (${state.keys[name][0]})` : "");

  // Buttons never take the keyboard from the tools.
  const button = (parent, text, press, facts = {}) => {
    const content = ICONS[text] ? icon(text) : text;
    const element = make(parent, "button", { type: "button", ariaLabel: text, onclick: press, ...facts }, content);
    element.onpointerdown = (event) => event.preventDefault();
    return element;
  };
  const action = (parent, name, facts) =>
    follows(button(parent, name, () => say({ do: name }), facts), (element, state) => {
      element.disabled = state.idle?.includes(name) ?? false;
      element.title = name + keyOf(state, name);
      if (name.startsWith("Download: ")) element.textContent = name.slice(10);
    });
  const put = (name) => (event) => {
    const { type, checked, value } = event.target;
    say({ set: name, to: type === "checkbox" ? checked : type === "range" ? Number(value) : value });
    if (event.target.matches("select")) event.target.blur();
  };

  function control(parent, name, state) {
    const { value, options, limits } = state.controls[name];
    if (options && !["Format", "For"].includes(name)) {
      const group = make(parent, "div", { className: "gt-choice", role: "group", ariaLabel: name });
      if (name in SETTINGS || parent.closest("#gt-panel")) make(group, "label", {}, name);
      for (const option of options.filter((each) => each !== "Up by 3 points"))
        follows(button(group, option, () => say({ set: name, to: option })), (element, state) => {
          element.ariaPressed = String(state.controls[name].value === option);
          element.title = option + keyOf(state, option);
          if (name !== "Backdrop") return;
          (element.className = "gt-dot"), (element.textContent = ""), (element.style.background = BACKDROPS[option]);
        });
      return group;
    }
    const plain = name in SETTINGS;
    const label = make(parent, "label", { className: plain ? "gt-choice" : value === true || value === false ? "gt-switch" : "gt-field" });
    if (typeof value === "boolean") {
      const input = make(label, "input", { type: "checkbox", onchange: put(name) });
      follows(input, (element, state) => (element.checked = state.controls[name].value));
      input.onclick = () => input.blur();
      label.append(name);
      return label;
    }
    label.append(name);
    const kind = options ? "select" : name.startsWith("The same") ? "textarea" : "input";
    const input = make(label, kind, { onchange: put(name), ariaLabel: name });
    if (kind === "input") input.type = limits ? "range" : "text";
    if (limits) ([input.min, input.max] = limits), (input.oninput = input.onchange), (input.onpointerup = () => input.blur());
    for (const option of options ?? []) make(input, "option", {}, option);
    if (kind === "textarea") (input.readOnly = true), follows(label, (element, state) => (element.hidden = !state.controls[name].value));
    follows(input, (element, state) => document.activeElement === element || (element.value = state.controls[name].value));
    return label;
  }

  function list(parent) {
    const rows = make(parent, "div", { style: "width:100%" });
    let shown;
    follow.push(({ objects }) => {
      const now = JSON.stringify(objects);
      if (now === shown || rows.contains(document.activeElement) && document.activeElement.matches("input")) return;
      shown = now;
      rows.replaceChildren(...(objects ?? []).map(row));
    });
    rows.addEventListener("focusout", () => setTimeout(changed));
  }

  function row({ id, name, colour, hidden, locked, active, selected, cut }) {
    const tell = (what, to) => say({ object: id, what, to });
    const element = make(null, "div", { className: `gt-object${active ? " active" : ""}`, title: "Click to mark this object" });
    element.onclick = (event) => !event.target.closest("button, input:focus") && tell("active", true);
    const swatch = "#" + colour.map((part) => part.toString(16).padStart(2, "0")).join("");
    button(element, "hidden", () => tell("hidden", !hidden), { title: hidden ? "Show it" : "Hide it", className: hidden ? "off" : "" });
    button(element, "locked", () => tell("locked", !locked), {
      title: locked ? "Unlock it" : "Lock it: no other object gets what it has", className: locked ? "" : "off",
    });
    make(element, "input", { type: "color", value: swatch, title: "Colour", onchange: (event) => (tell("colour", event.target.value), event.target.blur()) });
    const field = make(element, "input", { type: "text", value: name, ariaLabel: "Name", title: "Double click to rename", readOnly: true });
    field.ondblclick = () => ((field.readOnly = false), field.select());
    field.onpointerdown = (event) => field.readOnly && event.detail < 2 && event.preventDefault();
    field.onchange = () => tell("name", field.value);
    field.onblur = () => (field.readOnly = true);
    make(element, "small", { title: "Gaussians" }, cut ? `✂ ${cut.toLocaleString("en")}` : selected.toLocaleString("en"));
    button(element, "delete", () => tell("delete", true), { title: "Delete the object" });
    return element;
  }

  function chooser(parent) {
    button(parent, "Choose a file", () => document.querySelector('input[type="file"]')?.click());
  }
  function up(parent) {
    follows(make(parent, "div"), (element, state) => (element.textContent = state.up ?? ""));
  }
  function help(parent) {
    const table = make(parent, "table");
    follow.push(({ keys }) => {
      const rows = [...Object.entries(keys).map(([does, [key]]) => [key, does]), ...HELD];
      if (table.rows.length === rows.length) return;
      table.replaceChildren();
      for (const [key, does] of rows) make(table, "tr", {}, make(null, "td", {}, key), make(null, "td", {}, does));
    });
  }

  function build(state) {
    const picture = make(document.body, "div", { id: "gt-picture" });
    const panel = make(document.body, "div", { id: "gt-panel" });
    const withScene = (element) => follows(element, (each, now) => (each.hidden = !now.scene));
    const low = make(picture, "div", { className: "gt-low" });
    addStatus(low);
    const settings = withScene(make(low, "div", { className: "gt-settings" }));
    for (const [name, tools] of Object.entries(SETTINGS))
      follows(control(settings, name, state), (element, now) => (element.hidden = !tools.includes(now.controls.Tool.value)));
    follows(action(settings, "Apply the box"), (element, now) => (element.hidden = now.controls.Tool.value !== "3D box"));
    const bar = withScene(make(low, "div", { className: "gt-bar", role: "toolbar" }));
    bar.append(...control(bar, "Tool", state).children);
    bar.querySelector("div")?.remove();
    for (const name of ["", "Grow", "Shrink", "Invert", "", "Undo", "Redo"])
      name ? action(bar, name) : make(bar, "span", { className: "gt-gap" });

    const high = withScene(make(picture, "div", { className: "gt-high" }));
    for (const name of ["Show", "Trim", "Colours", "Backdrop"]) control(high, name, state);
    const legend = make(high, "div", { className: "gt-legend" });
    for (const [colour, meaning] of Object.entries(CHANGES)) make(legend, "div", {}, make(null, "i", { style: `background:${colour}` }), meaning);
    follows(legend, (element, now) => (element.hidden = now.controls.Colours.value !== "Changes"));
    follows(make(picture, "div", { className: "gt-compared" }), (element, now) => {
      (element.textContent = now.compared), (element.hidden = !now.compared);
    });
    addDrop(picture, state);

    for (const [title, lines] of PANEL) {
      const part = title ? make(panel, "details", { open: title === "Save" }, make(null, "summary", {}, title)) : make(panel, "div");
      if (!["File", "Keys"].includes(title)) withScene(part);
      for (const line of lines) {
        const section = make(part, "section");
        for (const what of line) {
          if (typeof what === "function") what(section);
          else if (what[0] === "=") control(section, what.slice(1), state);
          else if (what === "Download") make(section, "span", {}, what);
          else action(section, what.replace("!", ""), what[0] === "!" ? { className: "main" } : {});
        }
      }
    }
    page.signal.addEventListener("abort", () => (picture.remove(), panel.remove()));
    return { picture, panel };
  }

  function addDrop(picture, { starts }) {
    const drop = make(picture, "div", { className: "gt-drop" }, make(null, "h2", {}, "Drop a splat scene here"));
    make(drop, "div", {}, "PLY, SPLAT, SPZ, SOG, KSPLAT or glTF");
    chooser(drop);
    for (const [label, path, cameras] of starts)
      button(drop, label, () => (say({ set: "Scene", to: path }), say({ set: "Cameras", to: cameras }), say({ do: "Open" })), { title: path });
    follows(drop, (element, { scene, share }) => (element.hidden = Boolean(scene) || (share ?? null) !== null));
  }

  // What is going on, with a bar and Cancel, or what was done.
  function addStatus(low) {
    const status = make(low, "div", { className: "gt-status", role: "status" });
    const cancel = action(status, "Cancel"); // it stays the same at each stage, so that a press is not lost
    const sentence = make(status, "span");
    const progress = make(status, "div");
    let shown;
    follow.push(({ said, share, wrong }) => {
      const busy = (share ?? null) !== null;
      status.className = `gt-status${busy ? " busy" : ""}${wrong ? " wrong" : ""}`;
      (cancel.hidden = progress.hidden = !busy), (progress.style.width = `${100 * share}%`);
      if (shown === said) return;
      shown = said;
      sentence.replaceChildren();
      said.split(/'([^']*[/\\][^']*)'/).forEach((text, i) => {
        if (i % 2 === 0) return sentence.append(text);
        const path = button(sentence, text, () => navigator.clipboard?.writeText(text).then(() => (path.title = "Copied")));
        path.title = "Copy this path";
      });
    });
  }

  let built;
  window.gaussianTrimmerPage.draw = (state, box) => {
    built ??= build(state);
    const { picture, panel } = built;
    for (const [side, value] of Object.entries({ left: box.left, top: box.top, width: box.width, height: box.height }))
      picture.style[side] = `${value}px`;
    panel.style.width = `${Math.max(window.innerWidth - box.right, Math.min(280, window.innerWidth / 2))}px`;
    for (const act of follow) act(state);
  };
  changed();
})();

// @ts-check
// The page's own surface: a toolbar and the tool's settings over the picture, a status line, what is seen, a place to drop
// files, and the panel beside it. Names of controls and actions are those of `page.py`.
/** @typedef {import("./link.js").Link} Link */

const ICONS = {
  Look: "M2 10s3-5 8-5 8 5 8 5-3 5-8 5-8-5-8-5zM10 8a2 2 0 1 0 0 4 2 2 0 0 0 0-4z",
  Click: "M4 3l12 7-5 1 3 5-2 1-3-5-4 4z",
  Colour: "M16 4l-2-1-3 3 3 3 3-3zM12 8l-7 7-2 2 1-3 7-7",
  Box: "M3 5h3M8 5h4M14 5h3v3M17 10v2M17 14v1h-3M12 15H8M6 15H3v-3M3 10V8",
  Lasso: "M10 4c4 0 7 2 7 4.500s-3 4.500-7 4.500-7-2-7-4.500S6 4 10 4zM6 12.500c-1.500 1-1 3 1 5",
  Polygon: "M4 8l7-5 6 6-3 8H6z",
  Brush: "M17 3l-8 8M9 11c-2 0-3 1-3 3 0 1-1 2-3 2 2 2 8 2 8-2 0-1-1-3-2-3z",
  Sphere: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM3 10c0 4 14 4 14 0",
  "3D box": "M10 2l7 4v8l-7 4-7-4V6zM3 6l7 4 7-4M10 10v8",
  Move: "M10 2v16M2 10h16M10 2l-2 3M10 2l2 3M10 18l-2-3M10 18l2-3M2 10l3-2M2 10l3 2M18 10l-3-2M18 10l-3 2",
  Rotate: "M16 10a6 6 0 1 1-2-4.500M14 2v4h-4",
  Scale: "M3 9v8h8zM9 11l8-8M17 8V3h-5",
  Grow: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM10 7v6M7 10h6",
  Shrink: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM7 10h6",
  Invert: "M10 3a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM10 3v14M10 6l5 0M10 10h7M10 14h5",
  Undo: "M7 4L3 8l4 4M3 8h9a4 4 0 0 1 0 8H8",
  Redo: "M13 4l4 4-4 4M17 8H8a4 4 0 0 0 0 8h4",
  locked: "M5 9h10v8H5zM7 9V6a3 3 0 0 1 6 0v3",
  delete: "M4 6h12M8 6V4h4v2M6 6l1 11h6l1-11",
  hidden: "M2 10s3-5 8-5 8 5 8 5-3 5-8 5-8-5-8-5zM10 8a2 2 0 1 0 0 4 2 2 0 0 0 0-4z",
};
const DRAWN = ["Box", "Lasso", "Polygon", "Brush"];
const SETTINGS = /** @type {Record<string, string[]>} */ ({
  Mode: ["Click", "Colour", ...DRAWN, "Sphere", "3D box"], Reach: DRAWN, "Take by": DRAWN, "Brush radius": ["Brush", "Sphere"], Tolerance: ["Click", "Colour"],
});
const CHANGES = { "#14b464": "added", "#de3c28": "removed", "#3c82e6": "cut at the outline", "#f5e13c": "made up" };
const PANEL = /** @type {[string, string[][]][]} */ ([
  ["", [["!Cut out"], ["Find objects", "New object", "Unhide all", "*adder"], ["*list"]]],
  ["Save", [
    ["Download", "Download: Object", "Download: Scene without it", "Download: All files"], ["=Format"], ["=For"], ["=Folder"],
    ["=Earlier results"], ["Save in this folder"], ["Cut out and save all objects"], ["=The same by command"],
  ]],
  ["File", [
    ["*chooser"], ["=Scene"], ["=Cameras"], ["Open", "Apply cameras to this scene"], ["=Selection"],
    ["Replace the marks by this file"], ["Download the project"], ["*up"], ["=Up is"], ["Up by three clicks on the ground"],
  ]],
  ["Options", [["=Take in what is attached"], ["=Fit the outline"], ["=Clean the background"], ["=Continue the surface"], ["=Take along what stands on it"], ["=Virtual cameras"]]],
  ["Keys", [["*help"]]],
]);
const HELD = [
  ["Space", "compare, while held"], ["Shift", "the rest as a ghost, while held"], ["Shift, Ctrl, both", "add, remove, keep only, regardless of the mode"],
  ["Alt", "turn the view while a tool is chosen"], ["W A S D, Q E", "fly; with Shift faster"], ["Arrows", "turn the head"],
  ["F2", "rename the object"], ["Enter, Esc", "leave a field"],
];
const FADED_MILLISECONDS = 8000;
const GONE = "The program is gone. Start 'gaussian-trimmer view' again: this page comes back by itself, and your marks are kept.";

/** @param {Element | null} parent @param {string} name @param {Record<string, any>=} facts @param {(Node | string)[]} inside @returns {any} */
function make(parent, name, facts = {}, ...inside) {
  const element = Object.assign(document.createElement(name), facts);
  element.append(...inside);
  parent?.append(element);
  return element;
}

/** Draws the surface once, and brings it up to the state whenever that is another one. */
export class Panel {
  /** @param {Link} link @param {HTMLElement} picture @param {HTMLElement} panel */
  constructor(link, picture, panel) {
    (this.link = link), (this.picture = picture), (this.panel = panel);
    /** @type {(() => void)[]} */ this.followers = [];
    this.isLost = false;
    this.chosen = make(document.body, "input", { type: "file", hidden: true, ariaLabel: "A file", onchange: () => this.upload(this.chosen.files, this.beside) });
    this.beside = false; // whether what is chosen is to be an object beside the open scene
    window.addEventListener("dragover", (event) => event.dataTransfer?.types.includes("Files") && (event.preventDefault(), this.over(event)));
    window.addEventListener("dragleave", (event) => event.relatedTarget || this.over(null));
    window.addEventListener("drop", (event) => {
      const beside = this.isBeside(event);
      this.over(null);
      if (event.dataTransfer?.files.length) event.preventDefault(), this.upload(event.dataTransfer.files, beside);
    });
    window.addEventListener("keydown", (event) => event.key === "F2" && (event.preventDefault(), this.rename()));
  }

  /** Dropped on the panel, a scene becomes an object. @param {Event} event */
  isBeside(event) {
    return Boolean(this.link.state.scene) && event.target instanceof Node && this.panel.contains(event.target);
  }

  /** Show where a file would be dropped. @param {Event | null} event */
  over(event) {
    const beside = event !== null && this.isBeside(event);
    this.picture.classList.toggle("over", event !== null && !beside);
    this.panel.classList.toggle("over", beside);
  }

  /** @param {FileList} files @param {boolean} beside */
  async upload(files, beside) {
    for (const file of files) await this.link.upload(file, beside);
    this.chosen.value = "";
  }

  /** Bring everything up to the state. */
  follow() {
    if (!this.built && this.link.controls.Tool) (this.built = true), this.build();
    for (const act of this.followers) act();
  }

  /** @param {boolean} lost whether the program is gone */
  lose(lost) {
    this.isLost = lost;
    for (const part of [this.picture, this.panel]) part.classList.toggle("lost", lost);
    this.follow();
  }

  /** @template T @param {T} element @param {(element: T) => void} act @returns {T} */
  follows(element, act) {
    this.followers.push(() => act(element));
    return element;
  }

  get controls() {
    return this.link.controls;
  }

  /** @param {string} name */
  icon(name) {
    const holder = make(null, "span");
    holder.innerHTML = `<svg viewBox="0 0 20 20" aria-hidden="true"><path d="${ICONS[/** @type {keyof typeof ICONS} */ (name)]}"/></svg>`;
    return holder.firstChild;
  }

  /** @param {string} name */
  keyOf(name) {
    const key = this.link.state.keys?.[name];
    return key ? ` (${key})` : "";
  }

  /** Buttons that are pressed by a pointer never take the keyboard from the tools. @param {Element | null} parent @param {string} text @param {() => void} press @param {Record<string, any>=} facts */
  button(parent, text, press, facts = {}) {
    const element = make(parent, "button", { type: "button", ariaLabel: text, onclick: press, ...facts }, text in ICONS ? this.icon(text) : text);
    element.onpointerdown = (/** @type {Event} */ event) => {
      event.preventDefault();
      /** @type {HTMLElement} */ (document.activeElement)?.blur(); // what is typed is entered first
    };
    return element;
  }

  /** @param {Element} parent @param {string} name @param {Record<string, any>=} facts */
  action(parent, name, facts) {
    return this.follows(this.button(parent, name, () => this.link.say({ is: "do", action: name }), facts), (element) => {
      element.disabled = this.link.state.idle?.includes(name) ?? false;
      element.title = name + this.keyOf(name) + (name === "Cut out and save all objects" ? `, to ${this.link.state.folder}` : "");
      if (name.startsWith("Download: ")) element.textContent = name.slice(10);
    });
  }

  /** @param {Element} parent @param {string} name */
  control(parent, name) {
    const { value, options, limits } = this.controls[name], { link } = this;
    if (options && !["Format", "For"].includes(name)) {
      const group = make(parent, "div", { className: "gt-choice", role: "group", ariaLabel: name });
      if (name in SETTINGS || parent.closest("#gt-panel")) make(group, "span", {}, name);
      for (const option of options.filter((each) => each !== "Up by 3 points"))
        this.follows(this.button(group, option, () => this.choose(name, option)), (element) => {
          element.ariaPressed = String(this.controls[name].value === option);
          element.title = option + this.keyOf(option);
          element.disabled = this.link.state.idle?.includes(option) ?? false;
          if (name === "Backdrop") (element.className = `gt-dot ${option.toLowerCase()}`), (element.textContent = "");
        });
      return group;
    }
    const put = (/** @type {any} */ { target }) => {
      link.enter(name, target.type === "checkbox" ? target.checked : target.type === "range" ? Number(target.value) : target.value);
      if (target.matches("select, [type=checkbox]")) target.blur();
    };
    if (typeof value === "boolean") {
      const label = make(parent, "label", { className: "gt-switch" });
      this.follows(make(label, "input", { type: "checkbox", onchange: put }), (element) => (element.checked = this.controls[name].value));
      label.append(name);
      return label;
    }
    const label = make(parent, "label", { className: name in SETTINGS ? "gt-choice" : "gt-field" }, make(null, "span", {}, name));
    const kind = options ? "select" : name.startsWith("The same") ? "textarea" : "input";
    const input = make(label, kind, { onchange: put, ariaLabel: name });
    if (kind === "input") input.type = limits ? "range" : "text";
    if (limits) ([input.min, input.max] = limits), (input.oninput = put), (input.onpointerup = () => input.blur());
    for (const option of options ?? []) make(input, "option", {}, option);
    if (kind === "textarea") (input.readOnly = true), this.follows(label, (element) => (element.hidden = !this.controls[name].value));
    this.follows(input, (element) => document.activeElement === element || (element.value = this.controls[name].value));
    return label;
  }

  /** Tools and what is seen change here at once. @param {string} name @param {string} option */
  choose(name, option) {
    this.link.enter(name, option);
    this.picture.focus();
  }

  /** @param {Element} parent */
  list(parent) {
    const rows = make(parent, "div", { className: "gt-objects", role: "list", ariaLabel: "Objects" });
    let shown = "";
    this.followers.push(() => {
      const { objects = [] } = this.link.state, now = JSON.stringify(objects), inside = document.activeElement;
      if (now === shown || (rows.contains(inside) && inside?.matches("input:not([readonly])"))) return;
      const place = [...rows.children].findIndex((each) => each.contains(inside));
      shown = now;
      rows.replaceChildren(...objects.map((/** @type {any} */ each) => this.row(each)));
      if (place >= 0) rows.children[Math.min(place, rows.children.length - 1)]?.focus();
    });
    rows.addEventListener("focusout", () => setTimeout(() => this.follow()));
    this.rows = rows;
  }

  /** @param {any} object */
  row({ id, name, colour, hidden, locked, active, selected, cut }) {
    const tell = (/** @type {string} */ what, /** @type {any} */ value) => this.link.say({ is: "alter", object: id, what, value });
    const element = make(null, "div", { className: `gt-object${active ? " active" : ""}`, role: "listitem", tabIndex: 0, ariaLabel: name, title: "Click to mark this object" });
    element.setAttribute("aria-current", String(active));
    // A handler that returns false would take the event from the browser.
    element.onclick = (/** @type {any} */ event) => void (event.target.closest("button, input:focus") || tell("active", true));
    element.onkeydown = (/** @type {KeyboardEvent} */ event) => void (event.key === "Enter" && event.target === element && tell("active", true));
    const swatch = "#" + colour.map((/** @type {number} */ part) => part.toString(16).padStart(2, "0")).join("");
    const mark = (/** @type {string} */ text, /** @type {() => void} */ press, /** @type {boolean} */ on, /** @type {string} */ title) =>
      this.button(element, text, press, { title, className: on ? "" : "off", ariaLabel: `${title}: ${name}` });
    mark("hidden", () => tell("hidden", !hidden), !hidden, hidden ? "Show it" : "Hide it");
    mark("locked", () => tell("locked", !locked), locked, locked ? "Unlock it" : "Lock it: no other object gets what it has");
    make(element, "input", { type: "color", value: swatch, title: "Colour", ariaLabel: `Colour of ${name}`, onchange: (/** @type {any} */ event) => (tell("colour", event.target.value), event.target.blur()) });
    const field = make(element, "input", { type: "text", value: name, ariaLabel: "Name", title: "Double click or F2 to rename", readOnly: true, tabIndex: -1 });
    field.ondblclick = () => ((field.readOnly = false), field.focus(), field.select());
    field.onpointerdown = (/** @type {PointerEvent} */ event) => void (field.readOnly && event.detail < 2 && event.preventDefault());
    field.onchange = () => tell("name", field.value);
    field.onblur = () => (field.readOnly = true);
    make(element, "small", { title: cut ? "Gaussians, cut out" : "Gaussians, selected" }, cut ? `\u2702 ${cut.toLocaleString("en")}` : selected.toLocaleString("en"));
    mark("delete", () => tell("delete", true), true, "Delete the object");
    return element;
  }

  rename() {
    this.rows?.querySelector(".active input[type=text]")?.dispatchEvent(new MouseEvent("dblclick"));
  }

  /** @param {Element} parent */
  chooser(parent) {
    this.button(parent, "Choose a file", () => ((this.beside = false), this.chosen.click()));
  }

  /** @param {Element} parent */
  adder(parent) {
    this.button(parent, "Add a scene as an object", () => ((this.beside = true), this.chosen.click()), { title: "Or drop it here, on the panel" });
  }

  /** @param {Element} parent */
  up(parent) {
    this.follows(make(parent, "div"), (element) => (element.textContent = this.link.state.up ?? ""));
  }

  /** @param {Element} parent */
  help(parent) {
    const table = make(parent, "table");
    this.followers.push(() => {
      const rows = [...Object.entries(this.link.state.keys ?? {}).map(([does, key]) => [key, does]), ...HELD];
      if (table.rows.length === rows.length) return;
      table.replaceChildren();
      for (const [key, does] of rows) make(table, "tr", {}, make(null, "td", {}, key), make(null, "td", {}, does));
    });
  }

  build() {
    const { picture, panel } = this, withScene = (/** @type {any} */ element) => this.follows(element, (each) => (each.hidden = !this.link.state.scene));
    this.addStatus(picture);
    const low = make(picture, "div", { className: "gt-low" }), settings = withScene(make(low, "div", { className: "gt-settings" }));
    for (const [name, tools] of Object.entries(SETTINGS)) this.follows(this.control(settings, name), (element) => (element.hidden = !tools.includes(this.controls.Tool.value)));
    for (const [name, tools] of [["Apply the box", ["3D box"]], ["Put it back", ["Move", "Rotate", "Scale"]]])
      this.follows(this.action(settings, /** @type {string} */ (name)), (element) => (element.hidden = !tools.includes(this.controls.Tool.value)));
    const bar = withScene(make(low, "div", { className: "gt-bar", role: "toolbar", ariaLabel: "Tools" }));
    bar.append(...this.control(bar, "Tool").children);
    let tool = "";
    this.follows(bar, () => {
      if (tool === this.controls.Tool.value) return;
      tool = this.controls.Tool.value;
      bar.querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
    });
    bar.querySelector("div")?.remove();
    for (const name of ["", "Grow", "Shrink", "Invert", "", "Undo", "Redo"]) name ? this.action(bar, name) : make(bar, "span", { className: "gt-gap" });

    const high = withScene(make(picture, "div", { className: "gt-high" }));
    for (const name of ["Show", "Trim", "Colours", "Backdrop"]) this.control(high, name);
    const legend = make(picture, "div", { className: "gt-legend" });
    for (const [colour, meaning] of Object.entries(CHANGES)) make(legend, "div", {}, make(null, "i", { style: `background:${colour}` }), meaning);
    this.follows(legend, (element) => (element.hidden = !this.link.state.scene || this.controls.Colours.value !== "Changes"));
    this.compared = make(picture, "div", { className: "gt-compared", hidden: true });
    this.addDrop(picture);

    this.button(panel, "Objects and files", () => panel.classList.toggle("open"), { className: "gt-grip" });
    for (const [title, lines] of PANEL) {
      const part = title ? make(panel, "details", { open: title === "Save" }, make(null, "summary", {}, title)) : make(panel, "div");
      if (!["File", "Keys"].includes(title)) withScene(part);
      for (const line of lines) {
        const section = make(part, "section");
        for (const what of line) {
          if (what[0] === "*") this[/** @type {"list" | "adder" | "chooser" | "up" | "help"} */ (what.slice(1))](section);
          else if (what[0] === "=") this.control(section, what.slice(1));
          else if (what === "Download") make(section, "span", {}, what);
          else this.action(section, what.replace("!", ""), what[0] === "!" ? { className: "main" } : {});
        }
      }
    }
  }

  /** @param {Element} picture */
  addDrop(picture) {
    const drop = make(picture, "div", { className: "gt-drop" }, make(null, "h2", {}, "Drop a splat scene here"));
    make(drop, "div", {}, "PLY, SPLAT, SPZ, SOG, KSPLAT or glTF");
    this.chooser(drop);
    const starts = make(drop, "div");
    let shown = "";
    this.follows(drop, (element) => {
      const { scene, share } = this.link.state, offered = this.link.state.starts ?? [];
      element.hidden = Boolean(scene) || (share ?? null) !== null;
      if (JSON.stringify(offered) === shown) return;
      shown = JSON.stringify(offered);
      starts.replaceChildren();
      for (const [label, path, cameras] of offered) this.button(starts, label, () => this.open(path, cameras), { title: path });
    });
  }

  /** @param {string} path @param {string} cameras */
  open(path, cameras) {
    this.link.enter("Scene", path), this.link.enter("Cameras", cameras);
    this.link.say({ is: "do", action: "Open" });
  }

  /** What is going on, with a bar and Cancel, or what was done. @param {Element} picture */
  addStatus(picture) {
    const status = make(picture, "div", { className: "gt-status", role: "status" });
    const cancel = this.action(status, "Cancel"); // it stays the same at each stage, so that a press is not lost
    const sentence = make(status, "span"), progress = make(status, "div");
    let shown = "", fading = 0;
    this.followers.push(() => {
      const { said = "", share = null, wrong } = this.isLost ? { said: GONE, wrong: true } : this.link.state, busy = share !== null;
      status.classList.toggle("busy", busy), status.classList.toggle("wrong", Boolean(wrong));
      (cancel.hidden = progress.hidden = !busy), (progress.style.width = `${100 * share}%`);
      if (shown === `${said} ${share}`) return;
      shown = `${said} ${share}`;
      clearTimeout(fading);
      status.classList.remove("old");
      if (!busy && !wrong && this.link.state.scene) fading = window.setTimeout(() => status.classList.add("old"), FADED_MILLISECONDS);
      sentence.replaceChildren();
      said.split(/'([^']*[/\\][^']*)'/).forEach((/** @type {string} */ text, /** @type {number} */ i) => {
        if (i % 2 === 0) return sentence.append(text);
        const path = this.button(sentence, text, () => navigator.clipboard?.writeText(text).then(() => (path.title = "Copied")));
        path.title = "Copy this path";
      });
    });
  }
}

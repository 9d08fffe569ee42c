// @ts-check
// The page: the canvas, the link to the program, the tools and the panel, and what is seen by the state of all of them.
import { Canvas } from "./canvas.js";
import { Link } from "./link.js";
import { Panel } from "./panel.js";
import { Tools } from "./tools.js";

const [EVERYTHING, OBJECT, WITHOUT] = [0, 1, 2], [SELECTION, CUT_OUT] = [0, 1], [OWN, OBJECTS] = [0, 1];
const picture = /** @type {HTMLElement} */ (document.getElementById("gt-picture"));
const element = /** @type {HTMLCanvasElement} */ (document.getElementById("gt-canvas"));
const canvas = new Canvas(element, (sentence) => {
  Object.assign(link.state, { said: sentence, wrong: true, share: null });
  panel.follow();
});
const link = new Link(canvas, changed, (lost) => panel.lose(lost));
const panel = new Panel(link, picture, /** @type {HTMLElement} */ (document.getElementById("gt-panel")));
const tools = new Tools(canvas, link, changed);
Object.assign(window, { gaussianTrimmer: { canvas, link, tools } });

/** What to compare with what is shown, and its name. @param {import("./canvas.js").Showing} showing @returns {[import("./canvas.js").Showing, string]} */
function compared(showing) {
  if (showing.part === OBJECT) {
    const when = showing.when === CUT_OUT ? SELECTION : CUT_OUT;
    return [{ ...showing, when }, when === CUT_OUT ? "Cut-out" : "Selection"];
  }
  if (showing.part === EVERYTHING) return [{ part: WITHOUT, when: CUT_OUT, colours: OWN, ghost: false }, "Without it"];
  return [{ part: EVERYTHING, when: SELECTION, colours: OWN, ghost: false }, "With it"];
}

function changed() {
  const { controls, state } = link;
  if (!controls.Tool) return;
  const at = (/** @type {string} */ name) => controls[name].options?.indexOf(controls[name].value) ?? 0;
  let showing = { part: at("Show"), when: at("Trim"), colours: at("Colours"), ghost: tools.ghost && at("Show") === OBJECT }, name = "";
  const objects = /** @type {any[]} */ (state.objects ?? []), active = objects.findIndex((each) => each.active);
  if (tools.comparing && objects[active]?.result) [showing, name] = compared(showing);
  else if (tools.comparing) Object.assign(state, { said: "There is nothing to compare yet: cut the object out first.", wrong: true });
  const palette = new Uint8Array(1024).fill(255);
  const without = (/** @type {any} */ each) => showing.part === WITHOUT && (each.active || (each.together && objects[active].together));
  objects.forEach((each, i) => palette.set([...each.colour, each.hidden || without(each) ? 0 : 255], 4 * Math.min(255, i + 1)));
  if (`${palette}` !== `${canvas.palette}`) canvas.setPalette(palette);
  const now = JSON.stringify([showing, active]);
  if (now !== seen) (seen = now), (canvas.showing = showing), (canvas.active = active + 1), canvas.stateChanged();
  tools.gizmo.follow();
  picture.className = `${picture.classList.contains("over") ? "over " : ""}${panel.isLost ? "lost " : ""}backdrop-${controls.Backdrop.value.toLowerCase()}`;
  panel.follow();
  if (panel.compared) (panel.compared.hidden = !name), (panel.compared.textContent = name);
  canvas.refresh();
}
let seen = "";

// Controls of the 3D view (drawing.js): mouse, touch, keys, tip, legend, menus.

// --- mouse, touch and keys ---------------------------------------------------------------------------------------

const fingers = new Map();
let spread = 0;
let middle = [0, 0];
let travelled = 0;

/** Distance of two fingers, and the point between them. */
function pinch() {
  const [a, b] = [...fingers.values()];
  return [Math.hypot(a[0] - b[0], a[1] - b[1]), [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]];
}

/** A place of the window on the canvas, from -1 to 1, right and up. */
function onCanvas([x, y]) {
  const frame = canvas.getBoundingClientRect();
  return [(2 * (x - frame.left)) / frame.width - 1, 1 - (2 * (y - frame.top)) / frame.height];
}

/** Move what is seen by so many pixels of the window. */
function moveBy(right, down) {
  const scale = reach();
  state.shift[0] -= (2 * right) / canvas.clientWidth / scale[0];
  state.shift[1] += (2 * down) / canvas.clientHeight / scale[1];
  redraw();
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  travelled = 0;
  if (fingers.size === 2) [spread, middle] = pinch();
});
canvas.addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) return pointAt([event.clientX, event.clientY]);
  const now = [event.clientX, event.clientY];
  const step = [now[0] - before[0], now[1] - before[1]];
  fingers.set(event.pointerId, now);
  travelled += Math.hypot(...step);
  if (travelled > 4) letGo();
  if (fingers.size === 2) {
    const [last, lastMiddle] = [spread, middle];
    [spread, middle] = pinch();
    moveBy(middle[0] - lastMiddle[0], middle[1] - lastMiddle[1]);
    zoomBy(spread / last, onCanvas(middle));
  } else if (event.shiftKey) {
    moveBy(...step);
  } else {
    turnBy(step[1] * 0.01, step[0] * 0.01);
    redraw();
  }
});
canvas.addEventListener("pointerup", (event) => {
  const tapped = fingers.delete(event.pointerId) && travelled <= 4;
  if (tapped) pointAt([event.clientX, event.clientY], event.pointerType === "touch");
});
canvas.addEventListener("pointercancel", (event) => fingers.delete(event.pointerId));
canvas.addEventListener("pointerleave", (event) => event.pointerType === "touch" || letGo());
canvas.addEventListener(
  "wheel",
  (event) => {
    if (document.activeElement !== canvas) return; // the wheel scrolls the page
    event.preventDefault();
    zoomBy(Math.exp(-0.0015 * event.deltaY), onCanvas([event.clientX, event.clientY]));
  },
  { passive: false },
);
canvas.addEventListener("keydown", (event) => {
  const turns = { ArrowLeft: [0, -0.1], ArrowRight: [0, 0.1], ArrowUp: [-0.1, 0], ArrowDown: [0.1, 0] };
  if (turns[event.key]) turnBy(...turns[event.key]), redraw();
  else if (event.key === "+" || event.key === "-") zoomBy(event.key === "+" ? 1.15 : 1 / 1.15);
  else if (event.key === "Escape") canvas.blur();
  else return;
  event.preventDefault();
});

// --- the value at a node -----------------------------------------------------------------------------------------

const digits = (value) => Number(value.toPrecision(4)).toString();
const withUnit = (value) =>
  state.field.zones ? state.field.zones[Math.round(value)].name : `${digits(value)} ${state.field.unit}`;

const pointed = { node: -1, from: null }; // the node, and the mouse position that chose it; null after a tap, whose node stays

/** The node at a place of the window: it keeps its tip while the view changes, or the mouse finds another one. */
function pointAt(place, stays = false) {
  pointed.node = nearestTo(place);
  pointed.from = stays ? null : place;
  showTip();
}
function letGo() {
  pointed.node = -1;
  pointed.from = null;
  part("tip").hidden = part("spot").hidden = true;
}

/** The node that is seen at a place of the window, the nearest to the eye of several; -1 if there is none. */
function nearestTo([x, y]) {
  const frame = canvas.getBoundingClientRect();
  const scale = reach();
  let [found, nearest, depth] = [-1, 14, -Infinity];
  for (let node = state.face.nodes[0]; node < state.face.nodes[1]; node++) {
    const [right, down, near] = projected(current.points, node, scale);
    const off = Math.hypot(right * frame.width - (x - frame.left), down * frame.height - (y - frame.top));
    if (off < nearest - 2 || (off < nearest + 2 && near > depth)) [found, nearest, depth] = [node, off, near];
  }
  return found;
}

/** The tip beside its node, wherever that is now; asked for after every change of the view. */
function showTip() {
  if (pointed.from) pointed.node = nearestTo(pointed.from);
  const { node } = pointed;
  const [tip, spot] = [part("tip"), part("spot")];
  const [across, down] = node < 0 ? [-1, -1] : projected(current.points, node);
  tip.hidden = spot.hidden = across < 0 || across > 1 || down < 0 || down > 1;
  if (tip.hidden) return;
  const [wide, high] = [canvas.clientWidth, canvas.clientHeight];
  const at = Array.from(surface.points.subarray(3 * node, 3 * node + 3), (x) => digits(x / data.length.factor)).join(", ");
  tip.textContent = `${withUnit(current.values[node])} at (${at}) ${data.length.unit}`;
  const left = Math.max(Math.min(across * wide + 12, wide - tip.offsetWidth - 6), 4);
  const top = Math.min(Math.max(down * high - 34, 4), high - tip.offsetHeight - 4);
  tip.style.transform = `translate(${left}px, ${top}px)`;
  spot.style.transform = `translate(${across * wide - 5}px, ${down * high - 5}px)`;
}

// --- updates -----------------------------------------------------------------------------------------------------

const stage = webgl();
let current = scene();

/** After a change of field, step, scale or arrows. */
function refresh() {
  box = boxAround();
  current = scene();
  stage.load(current);
  redraw();
}

/** After a change of the place one looks from. */
function redraw() {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  keepInFrame();
  stage.draw();
  axes();
  showTip();
}

function home() {
  const { direction, up } = state.face;
  Object.assign(state, { turn: orthonormal(direction, up), zoom: 1, shift: [0, 0] });
  redraw();
}

/** Where x, y and z point, in the corner of the view; the one nearest to the eye is drawn last. */
function axes() {
  const seen = data.axes.map(({ name, colour }, k) => {
    const [x, y, z] = state.turn.map((row) => row[k]);
    const length = Math.hypot(x, y);
    const [nameX, nameY] = length > 0.15 ? [x * (1 + 0.35 / length), y * (1 + 0.35 / length)] : [0.35, 0.35];
    const number = (value) => value.toFixed(3);
    return {
      z,
      drawn:
        `<g data-axis="${name}" stroke="${colour}" fill="${colour}"><circle r="0.1" stroke="none"/>` +
        `<line x2="${number(x)}" y2="${number(-y)}" stroke-width="0.12"/>` +
        `<text x="${number(nameX)}" y="${number(0.2 - nameY)}" stroke="none" font-size="0.6" text-anchor="middle">${name}</text></g>`,
    };
  });
  part("axes").innerHTML = seen.sort((a, b) => a.z - b.z).map((axis) => axis.drawn).join("");
}

// --- controls ----------------------------------------------------------------------------------------------------

/** The colour bar, or the names of the zones. */
function legend() {
  const { title, unit, colours, zones } = state.field;
  const [low, high] = colourRange();
  const legend = part("legend");
  legend.textContent = "";
  const add = (parent, kind, text, style = {}) => {
    const made = parent.appendChild(document.createElement(kind));
    made.textContent = text;
    Object.assign(made.style, style);
    return made;
  };
  if (zones) {
    const row = add(legend, "div", "");
    row.className = "zones";
    for (const { name, colour } of zones) add(add(row, "span", ""), "i", "", { background: colour }).after(name);
    return;
  }
  add(legend, "div", "", { background: `linear-gradient(to right, ${colours.join()})` }).className = "ramp";
  const ticks = add(legend, "div", "");
  ticks.className = "ticks";
  for (const share of [0, 0.25, 0.5, 0.75, 1]) add(ticks, "span", digits(Number((low + share * (high - low)).toPrecision(3))));
  const range = steps.length > 1 ? "; colours range over all steps" : "";
  add(legend, "div", `${unit ? `${title}, ${unit}` : title}${range}`).className = "title";
}

function control(name, kind, change) {
  const element = part(name);
  element.addEventListener(kind, () => (change(element), refresh()));
  return element;
}
const chooser = control("field", "change", (element) => ((state.field = data.fields[element.selectedIndex]), legend()));
for (const field of data.fields) chooser.add(new Option(field.title));
const side = control("face", "change", (element) => ((state.face = faces[element.selectedIndex]), legend(), letGo(), home()));
for (const face of faces) side.add(new Option(face.name));
side.selectedIndex = faces.indexOf(state.face);
side.closest("label").hidden = faces.length < 3;
const scale = control("scale", "input", (element) => {
  state.scale = Number(element.value);
  part("scale-value").textContent = `× ${digits(state.scale)}`;
});
Object.assign(scale, { max: 2 * data.scale, step: data.scale / 50, value: data.scale });
part("scale-value").textContent = `× ${digits(data.scale)}`;
control("arrows", "change", (element) => (state.arrows = element.checked));
const time = control("step", "input", (element) => {
  state.step = Number(element.value);
  part("step-value").textContent = steps[state.step].label;
});
Object.assign(time, { max: steps.length - 1, value: steps.length - 1 });
part("step-value").textContent = steps[state.step].label;
time.closest("label").hidden = steps.length < 2;
part("reset").addEventListener("click", home);
canvas.addEventListener("dblclick", home);
new ResizeObserver(redraw).observe(canvas);

legend();
refresh();

// Interactive 3D view of the contact surface: controls, legend, axes and updates.
// No library and no network.  Together with view_state.js, view_paint.js and view_hand.js, in one function of the page.

const stage = (data.flat ? null : webgl()) || flat();
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
canvas.dataset.drawn = stage.painted(); // for tests: number of pixels drawn
canvas.dataset.by = stage.kind;

// State of the view: the data of the page, and the direction of view.

const root = document.getElementById("view3d");
const canvas = root.querySelector("canvas");
const part = (name) => root.querySelector(`[data-part="${name}"]`);
const data = JSON.parse(document.getElementById("view3d-data").textContent);

// --- data --------------------------------------------------------------------------------------------------------

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const floats = (text) => new Float32Array(bytes(text));
const integers = (text) => new Uint32Array(bytes(text));

const surface = { points: floats(data.points), triangles: integers(data.triangles), edges: integers(data.edges) };
const ends = { nodes: [0, surface.points.length / 3], triangles: [0, surface.triangles.length], edges: [0, surface.edges.length] };
/** The faces to choose from: where each begins and ends among nodes, triangles and edges, and the direction in which it
 * is seen; the first is all of them. */
const faces = [{ name: "all", ...ends, direction: data.direction, up: data.up }, ...data.faces];
const normals = floats(data.normals);
const outline = { points: floats(data.outline.points), lines: integers(data.outline.lines) };
const steps = data.steps.map((step) => ({
  label: step.label,
  surface: floats(step.surface),
  outline: floats(step.outline),
  arrows: floats(step.arrows),
  values: Object.fromEntries(Object.entries(step.values).map(([name, text]) => [name, floats(text)])),
}));

/** Mean length of the edges of the cells, metres. */
const cellSize = (() => {
  let sum = 0;
  for (let k = 0; k < surface.edges.length; k += 2) {
    const [a, b] = [3 * surface.edges[k], 3 * surface.edges[k + 1]];
    sum += Math.hypot(...[0, 1, 2].map((c) => surface.points[a + c] - surface.points[b + c]));
  }
  return (2 * sum) / Math.max(surface.edges.length, 1) || data.size;
})();

// --- state -------------------------------------------------------------------------------------------------------

const first = faces[faces.length > 1 ? 1 : 0];
const state = {
  turn: orthonormal(first.direction, first.up), // rows: right, up and towards the viewer
  zoom: 1, // 1: the body fills the frame
  shift: [0, 0], // of the frame's centre from the body's centre, right and up, metres
  face: first,
  field: data.fields[0],
  step: steps.length - 1,
  scale: data.scale,
  arrows: true,
};

/** The range of a field on the face over that on all: less than 1 if its values are much smaller than others'. */
const shareOfFace = (field) => field.of_faces[state.face.name] ?? 1;
const largestArrow = () => data.arrow.largest * shareOfFace(data.fields.find(({ name }) => name === "friction_traction"));

/** Rows right, up and towards the eye, for an eye in this direction. */
function orthonormal(direction, up) {
  const towards = unit(direction);
  const right = unit(cross(up, towards));
  return [right, cross(towards, right), towards];
}
function unit(v) {
  const length = Math.hypot(...v) || 1;
  return v.map((entry) => entry / length);
}
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Turn what is seen by angles about the axes right and up of the screen. */
function turnBy(aboutRight, aboutUp) {
  const rotated = (u, v, angle) => [
    u.map((entry, k) => Math.cos(angle) * entry + Math.sin(angle) * v[k]),
    v.map((entry, k) => Math.cos(angle) * entry - Math.sin(angle) * u[k]),
  ];
  let [right, up, towards] = state.turn;
  [towards, right] = rotated(towards, right, -aboutUp);
  [up, towards] = rotated(up, towards, -aboutRight);
  state.turn = orthonormal(towards, up);
}

/** Points moved by their displacement, enlarged. */
function moved(points, displacement) {
  return points.map((entry, k) => entry + state.scale * displacement[k]);
}

// --- the frame ---------------------------------------------------------------------------------------------------

/** A box around the body, with its arrows, at every step and at this scale of the displacement: middle and corners. */
let box = boxAround();

function boxAround() {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  const largest = largestArrow();
  const grow = (points, displacement, [first, end], more) => {
    for (let k = 3 * first; k < 3 * end; k++) {
      const at = points[k] + state.scale * displacement[k];
      const end = more ? at + (more[k] / largest) * data.arrow.length : at;
      low[k % 3] = Math.min(low[k % 3], at, end);
      high[k % 3] = Math.max(high[k % 3], at, end);
    }
  };
  for (const step of steps) {
    grow(surface.points, step.surface, state.face.nodes, step.arrows);
    grow(outline.points, step.outline, [0, outline.points.length / 3]);
  }
  const middle = low.map((entry, k) => (entry + high[k]) / 2);
  const half = low.map((entry, k) => (high[k] - entry) / 2);
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((c) => half.map((entry, k) => ((c >> k) & 1 ? entry : -entry)));
  return { middle, corners, size: 2 * Math.hypot(...half) || data.size };
}

/** Half the width and height that the box takes on the screen, seen as now, metres. */
function extent() {
  return [0, 1].map((k) => Math.max(...box.corners.map((corner) => dot(state.turn[k], corner))) || box.size / 2);
}

/** Pixels of the canvas per metre: at zoom 1 the body, however it is turned, fills the frame. */
function pixelsPerMetre() {
  const [wide, high] = extent();
  return 0.46 * state.zoom * Math.min(canvas.width / wide, canvas.height / high);
}

/** What a metre is on the canvas, whose half width and half height are 1. */
function reach() {
  const pixels = pixelsPerMetre();
  return [(2 * pixels) / canvas.width, (2 * pixels) / canvas.height];
}

/** Keep the frame on the body: enlarged, its edges stay within those of the body; else the body is in the middle. */
function keepInFrame() {
  const [half, scale] = [extent(), reach()];
  state.shift = state.shift.map((entry, k) => {
    const room = Math.max(0, half[k] - 0.92 / scale[k]);
    return Math.min(Math.max(entry, -room), room);
  });
}

/** Enlarge by a factor; the place (-1 to 1, right and up) stays where it is. */
function zoomBy(factor, place = [0, 0]) {
  const before = reach();
  state.zoom = Math.min(Math.max(state.zoom * factor, 0.3), 30);
  const after = reach();
  state.shift = state.shift.map((entry, k) => entry + place[k] / before[k] - place[k] / after[k]);
  redraw();
}

/** Place of point `node` on the canvas, 0 to 1 from the top left, and how near it is to the eye. */
function projected(points, node, [wide, high] = reach()) {
  const at = [0, 1, 2].map((k) => points[3 * node + k] - box.middle[k]);
  const [right, up, towards] = state.turn;
  const across = wide * (dot(right, at) - state.shift[0]);
  const upward = high * (dot(up, at) - state.shift[1]);
  return [0.5 + 0.5 * across, 0.5 - 0.5 * upward, dot(towards, at)];
}

/** The same of all points. */
function project(points) {
  const scale = reach();
  return Array.from({ length: points.length / 3 }, (_, node) => projected(points, node, scale));
}

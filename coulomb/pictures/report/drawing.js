// Scrolling of wide tables, and the 3D view of the contact surface: its data, its state, and its drawing by
// WebGL 2.  No library, no network.  Together with controls.js in one function of the page.
//
// pyvista's HTML export (0.49) in its place needs trame-pyvista and trame (49 MB at least) and starts a web server to
// write a page.  It takes 1.1 MB a page, with vtk.js, for one field of one state, without colour bar, units, choice of fields,
// steps and scale, and values at nodes.  Both scripts have 26 kB; the data 63 kB for the six fields of the demo block,
// and 296 kB for nine fields at the 24 steps of the demo history.

addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((one) => (one.open = true)));

// --- scrolling ---------------------------------------------------------------------------------------------------

// Tables wider than the screen can be scrolled sideways; the page indicates where there is more.

for (const frame of document.querySelectorAll(".wide")) {
  const hint = document.createElement("p");
  hint.className = "more screen-only";
  frame.after(hint);
  const look = () => {
    const rest = frame.scrollWidth - frame.clientWidth;
    const [left, right] = [rest > 1 && frame.scrollLeft > 1, rest > 1 && frame.scrollLeft < rest - 1];
    frame.classList.toggle("more-left", left);
    frame.classList.toggle("more-right", right);
    hint.textContent = rest > 1 ? `${left ? "← " : ""}scroll sideways${right ? " →" : ""}` : "";
    if (rest > 1) frame.tabIndex = 0; // scrollable by keys as well
    else frame.removeAttribute("tabindex");
  };
  frame.addEventListener("scroll", look, { passive: true });
  new ResizeObserver(look).observe(frame);
  look();
}

// --- data ----------------------------------------------------------------------------------------------------

const root = document.getElementById("view3d");
const canvas = root.querySelector("canvas");
const part = (name) => root.querySelector(`[data-part="${name}"]`);
const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
if (!gl) {
  root.textContent = "The view needs WebGL 2, which this browser does not offer; the pictures below show the same.";
  return;
}
const data = JSON.parse(document.getElementById("view3d-data").textContent);

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

// --- geometry of a state ---------------------------------------------------------------------------------------

/** Flat arrows hovering over the surface, three triangles each, wider all around by a margin; their corners. */
function arrowCorners(points, margin) {
  const vectors = steps[state.step].arrows;
  const corners = [];
  for (let node = state.face.nodes[0]; node < state.face.nodes[1]; node += data.arrow.every) {
    const at = (array) => [array[3 * node], array[3 * node + 1], array[3 * node + 2]];
    const length = Math.hypot(...at(vectors)) / largestArrow(); // over the largest arrow, as below
    if (length < 0.04) continue;
    const along = unit(at(vectors));
    const side = cross(at(normals), along);
    const foot = at(points).map((entry, k) => entry + 0.004 * data.size * at(normals)[k]);
    const place = (forth, wide) => foot.map((entry, k) => entry + data.arrow.length * (forth * along[k] + wide * side[k]));
    const head = Math.min(0.3, 0.45 * length);
    const [neck, wide, wing, tip] = [length - head, 0.1 * head + margin, 0.38 * head + 2 * margin, length + 2 * margin];
    const shaft = [place(-margin, -wide), place(-margin, wide), place(neck, wide), place(neck, -wide)];
    corners.push(shaft[0], shaft[1], shaft[2], shaft[0], shaft[2], shaft[3]);
    corners.push(place(neck - margin, -wing), place(neck - margin, wing), place(tip, 0));
  }
  return new Float32Array(corners.flat());
}

/** Everything to draw, in metres. */
function scene() {
  const points = moved(surface.points, steps[state.step].surface);
  return {
    points,
    values: steps[state.step].values[state.field.name],
    outline: moved(outline.points, steps[state.step].outline),
    halos: state.arrows ? arrowCorners(points, 0.025) : new Float32Array(0),
    arrows: state.arrows ? arrowCorners(points, 0) : new Float32Array(0),
  };
}

/** Where the colours begin and end. */
const colourRange = () => [state.field.low, state.field.high].map((end) => end * shareOfFace(state.field));
const colourOf = (value) => {
  const { colours, zones } = state.field;
  const [low, high] = colourRange();
  if (zones) return zones[Math.round(value)].colour;
  const part = Math.min(Math.max((value - low) / (high - low), 0), 1);
  return colours[Math.round(part * (colours.length - 1))];
};
const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);

/** How dark mesh lines are, 0 to 1: where cells are only few pixels wide, lines would hide the colours. */
function lineStrength() {
  const pixels = (cellSize * pixelsPerMetre() * canvas.clientWidth) / canvas.width;
  return Math.min(Math.max((pixels - 3) / 17, 0), 0.9);
}

const [WHITE, BLACK] = [[1, 1, 1], [0.08, 0.08, 0.08]]; // black arrows with a white rim are visible on every colour

// --- drawing --------------------------------------------------------------------------------------------------

const VERTEX = `#version 300 es
  in vec3 point; in vec3 colour;
  in float zone;
  uniform mat3 turn; uniform vec3 centre; uniform vec2 reach; uniform vec2 shift; uniform float size; uniform float lift;
  out vec3 shade; out vec4 share;
  void main() {
    vec3 seen = turn * (point - centre);
    gl_Position = vec4((seen.xy - shift) * reach, -seen.z / size - lift, 1.0);
    shade = colour;
    share = vec4(equal(ivec4(int(zone + 0.5)), ivec4(0, 1, 2, 3)));
  }`;
// Zones are not blended: a point has the colour of the nearest corner of its triangle.
const FRAGMENT = `#version 300 es
  precision highp float;
  in vec3 shade; in vec4 share;
  uniform bool zoned; uniform vec3 zones[4]; uniform vec4 single;
  out vec4 result;
  void main() {
    float most = max(max(share.x, share.y), max(share.z, share.w));
    vec3 zone = share.x == most ? zones[0] : share.y == most ? zones[1] : share.z == most ? zones[2] : zones[3];
    result = single.a > 0.0 ? single : vec4(zoned ? zone : shade, 1.0);
  }`;

function webgl() {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(0, 0, 0, 0);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  const place = (name) => gl.getUniformLocation(program, name);
  const indices = [surface.triangles, surface.edges, outline.lines].map((array) => buffer(gl.ELEMENT_ARRAY_BUFFER, array));
  const arrays = Object.fromEntries(["points", "colours", "zones", "outline", "halos", "arrows"].map((name) => [name, gl.createBuffer()]));

  function buffer(target, array, of = gl.createBuffer()) {
    gl.bindBuffer(target, of);
    gl.bufferData(target, array, gl.STATIC_DRAW);
    return of;
  }
  function attribute(name, of, components) {
    const location = gl.getAttribLocation(program, name);
    if (!of) return gl.disableVertexAttribArray(location);
    gl.bindBuffer(gl.ARRAY_BUFFER, of);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, components, gl.FLOAT, false, 0, 0);
  }
  function elements(kind, index, [first, end]) {
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
    gl.drawElements(kind, end - first, gl.UNSIGNED_INT, 4 * first);
  }
  let drawn = null;

  return {
    load(what) {
      drawn = what;
      const colours = new Float32Array(what.points.length);
      what.values.forEach((value, node) => colours.set(rgb(colourOf(value)), 3 * node));
      buffer(gl.ARRAY_BUFFER, what.points, arrays.points);
      buffer(gl.ARRAY_BUFFER, colours, arrays.colours);
      buffer(gl.ARRAY_BUFFER, what.values, arrays.zones);
      buffer(gl.ARRAY_BUFFER, what.outline, arrays.outline);
      buffer(gl.ARRAY_BUFFER, what.halos, arrays.halos);
      buffer(gl.ARRAY_BUFFER, what.arrows, arrays.arrows);
    },
    draw() {
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const [right, up, towards] = state.turn;
      gl.uniformMatrix3fv(place("turn"), false, [0, 1, 2].flatMap((k) => [right[k], up[k], towards[k]]));
      gl.uniform3fv(place("centre"), box.middle);
      gl.uniform2fv(place("reach"), reach());
      gl.uniform2fv(place("shift"), state.shift);
      gl.uniform1f(place("size"), box.size);
      gl.uniform1i(place("zoned"), state.field.zones ? 1 : 0);
      if (state.field.zones) gl.uniform3fv(place("zones"), state.field.zones.flatMap((zone) => rgb(zone.colour)));
      const paint = (colour, lift) => {
        gl.uniform4fv(place("single"), colour);
        gl.uniform1f(place("lift"), lift);
      };
      attribute("point", arrays.points, 3);
      attribute("colour", arrays.colours, 3);
      attribute("zone", arrays.zones, 1);
      paint([0, 0, 0, 0], 0);
      elements(gl.TRIANGLES, indices[0], state.face.triangles);
      attribute("colour", null);
      attribute("zone", null);
      gl.enable(gl.BLEND);
      paint([0.4, 0.4, 0.4, Math.max(lineStrength(), 1e-3)], 0.0006);
      elements(gl.LINES, indices[1], state.face.edges);
      gl.disable(gl.BLEND);
      paint([0.5, 0.5, 0.5, 1], 0.0006);
      attribute("point", arrays.outline, 3);
      elements(gl.LINES, indices[2], [0, outline.lines.length]);
      for (const [name, colour, lift] of [["halos", WHITE, 0.001], ["arrows", BLACK, 0.0014]]) {
        attribute("point", arrays[name], 3);
        paint([...colour, 1], lift);
        gl.drawArrays(gl.TRIANGLES, 0, drawn[name].length / 3);
      }
    },
  };
}

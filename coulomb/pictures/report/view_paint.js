// Drawing of the contact surface: WebGL 2 if available, else triangles from back to front on a 2D canvas.

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

// --- drawing with WebGL ----------------------------------------------------------------------------------------

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
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return null;
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
    kind: "webgl",
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
    /** Number of pixels that are not empty. */
    painted() {
      const pixels = new Uint8Array(4 * canvas.width * canvas.height);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      return pixels.filter((value, k) => k % 4 === 3 && value > 0).length;
    },
  };
}

// --- drawing without ---------------------------------------------------------------------------------------------

function flat() {
  const pen = canvas.getContext("2d");
  let drawn = null;
  return {
    kind: "canvas",
    load: (what) => (drawn = what),
    draw() {
      pen.clearRect(0, 0, canvas.width, canvas.height);
      const seen = (points) => project(points).map(([x, y, z]) => [x * canvas.width, y * canvas.height, z]);
      const path = (corners) => {
        pen.beginPath();
        corners.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      };
      const lines = (places, pairs) => {
        for (let k = 0; k < pairs.length; k += 2) path([places[pairs[k]], places[pairs[k + 1]]]), pen.stroke();
      };
      const places = seen(drawn.points);
      const triangles = surface.triangles.subarray(...state.face.triangles);
      const depth = (k) => [0, 1, 2].reduce((sum, c) => sum + places[triangles[3 * k + c]][2], 0);
      const order = Array.from({ length: triangles.length / 3 }, (_, k) => k).sort((a, b) => depth(a) - depth(b));
      for (const k of order) {
        const nodes = triangles.subarray(3 * k, 3 * k + 3);
        const values = Array.from(nodes, (node) => drawn.values[node]);
        const mean = state.field.zones ? values.sort()[1] : (values[0] + values[1] + values[2]) / 3;
        pen.fillStyle = pen.strokeStyle = colourOf(mean);
        path(Array.from(nodes, (node) => places[node]));
        pen.closePath(), pen.fill(), pen.stroke();
      }
      pen.globalAlpha = lineStrength();
      pen.strokeStyle = "#666666";
      lines(places, surface.edges.subarray(...state.face.edges));
      pen.globalAlpha = 1;
      pen.strokeStyle = "#808080";
      lines(seen(drawn.outline), outline.lines);
      for (const [name, colour] of [["halos", WHITE], ["arrows", BLACK]]) {
        const corners = seen(drawn[name]);
        pen.fillStyle = `rgb(${colour.map((part) => 255 * part).join()})`;
        for (let k = 0; k < corners.length; k += 3) path(corners.slice(k, k + 3)), pen.fill();
      }
    },
    painted: () => pen.getImageData(0, 0, canvas.width, canvas.height).data.filter((v, k) => k % 4 === 3 && v > 0).length,
  };
}

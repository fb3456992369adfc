// The contact surface in three dimensions: drag to turn, wheel or pinch to zoom, point at a node to read its value.
// No library and no network: WebGL 2 where there is one, else triangles from back to front on a flat canvas.
"use strict";
(() => {
  const root = document.getElementById("view3d");
  const canvas = root.querySelector("canvas");
  const told = JSON.parse(document.getElementById("view3d-data").textContent);

  // --- data ------------------------------------------------------------------------------------------------------

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const floats = (text) => new Float32Array(bytes(text));
  const integers = (text) => new Uint32Array(bytes(text));

  const surface = { points: floats(told.points), triangles: integers(told.triangles), edges: integers(told.edges) };
  const normals = floats(told.normals);
  const outline = { points: floats(told.outline.points), lines: integers(told.outline.lines) };
  const steps = told.steps.map((step) => ({
    label: step.label,
    surface: floats(step.surface),
    outline: floats(step.outline),
    arrows: floats(step.arrows),
    values: Object.fromEntries(Object.entries(step.values).map(([name, text]) => [name, floats(text)])),
  }));

  // --- state -----------------------------------------------------------------------------------------------------

  const start = orthonormal(told.direction, told.up);
  const state = { turn: start, zoom: 1, field: told.fields[0], step: steps.length - 1, scale: told.scale, arrows: true };

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

  // --- geometry of a state ---------------------------------------------------------------------------------------

  /** Flat arrows hovering over the surface, three triangles each, wider all around by a margin; their corners. */
  function arrowCorners(points, margin) {
    const vectors = steps[state.step].arrows;
    const corners = [];
    for (let node = 0; node < vectors.length / 3; node += told.arrow.every) {
      const at = (array) => [array[3 * node], array[3 * node + 1], array[3 * node + 2]];
      const length = Math.hypot(...at(vectors)) / told.arrow.greatest; // over the greatest arrow, as all that follows
      if (length < 0.04) continue;
      const along = unit(at(vectors));
      const side = cross(at(normals), along);
      const foot = at(points).map((entry, k) => entry + 0.004 * told.size * at(normals)[k]);
      const place = (forth, wide) => foot.map((entry, k) => entry + told.arrow.length * (forth * along[k] + wide * side[k]));
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

  const colourOf = (value) => {
    const { low, high, colours, zones } = state.field;
    if (zones) return zones[Math.round(value)].colour;
    const part = Math.min(Math.max((value - low) / (high - low), 0), 1);
    return colours[Math.round(part * (colours.length - 1))];
  };
  const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);

  const [WHITE, BLACK] = [[1, 1, 1], [0.08, 0.08, 0.08]]; // arrows are black with a white rim: seen on every colour

  // --- drawing with WebGL ----------------------------------------------------------------------------------------

  const VERTEX = `#version 300 es
    in vec3 point; in vec3 colour;
    in float zone;
    uniform mat3 turn; uniform vec3 centre; uniform vec2 reach; uniform float size; uniform float lift;
    out vec3 shade; out vec4 share;
    void main() {
      vec3 seen = turn * (point - centre);
      gl_Position = vec4(seen.xy * reach, -seen.z / size - lift, 1.0);
      shade = colour;
      share = vec4(equal(ivec4(int(zone + 0.5)), ivec4(0, 1, 2, 3)));
    }`;
  // Zones do not blend: a point has the colour of the nearest corner of its triangle.
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
    function elements(kind, index, count) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
      gl.drawElements(kind, count, gl.UNSIGNED_INT, 0);
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
      draw(reach) {
        gl.viewport(0, 0, canvas.width, canvas.height);
        gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
        const [right, up, towards] = state.turn;
        gl.uniformMatrix3fv(place("turn"), false, [0, 1, 2].flatMap((k) => [right[k], up[k], towards[k]]));
        gl.uniform3fv(place("centre"), told.centre);
        gl.uniform2fv(place("reach"), reach);
        gl.uniform1f(place("size"), 2 * told.size);
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
        elements(gl.TRIANGLES, indices[0], surface.triangles.length);
        attribute("colour", null);
        attribute("zone", null);
        paint([0.5, 0.5, 0.5, 1], 0.0006);
        elements(gl.LINES, indices[1], surface.edges.length);
        attribute("point", arrays.outline, 3);
        elements(gl.LINES, indices[2], outline.lines.length);
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
      draw(reach) {
        pen.clearRect(0, 0, canvas.width, canvas.height);
        const seen = (points) => project(points, reach).map(([x, y, z]) => [x * canvas.width, y * canvas.height, z]);
        const path = (corners) => {
          pen.beginPath();
          corners.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
        };
        const lines = (places, pairs) => {
          for (let k = 0; k < pairs.length; k += 2) path([places[pairs[k]], places[pairs[k + 1]]]), pen.stroke();
        };
        const places = seen(drawn.points);
        const depth = (k) => [0, 1, 2].reduce((sum, c) => sum + places[surface.triangles[3 * k + c]][2], 0);
        const order = Array.from({ length: surface.triangles.length / 3 }, (_, k) => k).sort((a, b) => depth(a) - depth(b));
        for (const k of order) {
          const nodes = surface.triangles.subarray(3 * k, 3 * k + 3);
          const values = Array.from(nodes, (node) => drawn.values[node]);
          const mean = state.field.zones ? values.sort()[1] : (values[0] + values[1] + values[2]) / 3;
          pen.fillStyle = pen.strokeStyle = colourOf(mean);
          path(Array.from(nodes, (node) => places[node]));
          pen.closePath(), pen.fill(), pen.stroke();
        }
        pen.strokeStyle = "#808080";
        lines(places, surface.edges);
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

  /** Places on the canvas, 0 to 1 from the top left, and how near they are to the eye. */
  function project(points, reach) {
    const [right, up, towards] = state.turn;
    return Array.from({ length: points.length / 3 }, (_, node) => {
      const at = [0, 1, 2].map((k) => points[3 * node + k] - told.centre[k]);
      const along = (axis) => axis[0] * at[0] + axis[1] * at[1] + axis[2] * at[2];
      return [0.5 + 0.5 * reach[0] * along(right), 0.5 - 0.5 * reach[1] * along(up), along(towards)];
    });
  }

  const stage = (told.flat ? null : webgl()) || flat();
  let current = scene();

  /** Width and height of what is seen at the start, in metres. */
  const extent = [0, 1].map((k) => {
    const all = [...project(current.points, [1, 1]), ...project(current.outline, [1, 1])];
    return 4 * all.reduce((most, place) => Math.max(most, Math.abs(place[k] - 0.5)), 0) || told.size;
  });

  /** What a metre is on the canvas, whose half width and half height are 1. */
  function reach() {
    const pixels = 0.92 * state.zoom * Math.min(canvas.width / extent[0], canvas.height / extent[1]);
    return [(2 * pixels) / canvas.width, (2 * pixels) / canvas.height];
  }
  function refresh() {
    current = scene();
    stage.load(current);
    redraw();
  }
  function redraw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    stage.draw(reach());
  }

  // --- the reader's hand -------------------------------------------------------------------------------------------

  const part = (name) => root.querySelector(`[data-part="${name}"]`);
  const fingers = new Map();
  let spread = 0;

  const distance = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  function zoomBy(factor) {
    state.zoom = Math.min(Math.max(state.zoom * factor, 0.3), 30);
    redraw();
  }
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) spread = distance();
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return tell(event);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) {
      const now = distance();
      zoomBy(now / spread);
      spread = now;
    } else {
      turnBy((event.clientY - before[1]) * 0.01, (event.clientX - before[0]) * 0.01);
      redraw();
    }
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointerleave", () => (part("tip").hidden = true));
  canvas.addEventListener("wheel", (event) => (event.preventDefault(), zoomBy(Math.exp(-0.0015 * event.deltaY))), { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [0, -0.1], ArrowRight: [0, 0.1], ArrowUp: [-0.1, 0], ArrowDown: [0.1, 0] };
    if (turns[event.key]) turnBy(...turns[event.key]), redraw();
    else if (event.key === "+" || event.key === "-") zoomBy(event.key === "+" ? 1.15 : 1 / 1.15);
    else return;
    event.preventDefault();
  });

  const digits = (value) => Number(value.toPrecision(4)).toString();
  const withUnit = (value) => (state.field.zones ? state.field.zones[Math.round(value)].name : `${digits(value)} ${state.field.unit}`);

  /** The value at the node under the pointer. */
  function tell(event) {
    const box = canvas.getBoundingClientRect();
    const here = [event.clientX - box.left, event.clientY - box.top];
    let [found, nearest, depth] = [-1, 14, -Infinity];
    project(current.points, reach()).forEach(([x, y, z], node) => {
      const off = Math.hypot(x * box.width - here[0], y * box.height - here[1]);
      if (off < nearest - 2 || (off < nearest + 2 && z > depth)) [found, nearest, depth] = [node, off, z];
    });
    const tip = part("tip");
    tip.hidden = found < 0;
    if (found < 0) return;
    const at = Array.from(surface.points.subarray(3 * found, 3 * found + 3), (x) => digits(x / told.length.factor)).join(", ");
    tip.textContent = `${withUnit(current.values[found])} at (${at}) ${told.length.unit}`;
    tip.style.transform = `translate(${Math.min(here[0] + 14, box.width - tip.offsetWidth - 6)}px, ${Math.max(here[1] - 34, 4)}px)`;
  }

  // --- controls ----------------------------------------------------------------------------------------------------

  /** The colour bar, or the names of the zones. */
  function legend() {
    const { title, unit, low, high, colours, zones } = state.field;
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
    add(legend, "div", unit ? `${title}, ${unit}` : title).className = "title";
  }

  function control(name, kind, change) {
    const element = part(name);
    element.addEventListener(kind, () => (change(element), refresh()));
    return element;
  }
  const chooser = control("field", "change", (element) => ((state.field = told.fields[element.selectedIndex]), legend()));
  for (const field of told.fields) chooser.add(new Option(field.title));
  const scale = control("scale", "input", (element) => {
    state.scale = Number(element.value);
    part("scale-value").textContent = `× ${digits(state.scale)}`;
  });
  Object.assign(scale, { max: 2 * told.scale, step: told.scale / 50, value: told.scale });
  part("scale-value").textContent = `× ${digits(told.scale)}`;
  control("arrows", "change", (element) => (state.arrows = element.checked));
  const time = control("step", "input", (element) => {
    state.step = Number(element.value);
    part("step-value").textContent = steps[state.step].label;
  });
  Object.assign(time, { max: steps.length - 1, value: steps.length - 1 });
  part("step-value").textContent = steps[state.step].label;
  time.closest("label").hidden = steps.length < 2;
  const home = () => (Object.assign(state, { turn: start, zoom: 1 }), redraw());
  part("reset").addEventListener("click", home);
  canvas.addEventListener("dblclick", home);
  new ResizeObserver(redraw).observe(canvas);

  legend();
  refresh();
  canvas.dataset.drawn = stage.painted(); // for tests: what came of it
  canvas.dataset.by = stage.kind;
})();

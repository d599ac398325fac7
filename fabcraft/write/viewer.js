"use strict";
(() => {
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const canvas = document.getElementById("view"), sorry = document.getElementById("sorry");
  const legend = document.getElementById("legend"), tools = document.getElementById("tools");
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
  if (!gl) { sorry.textContent = "This browser offers no WebGL; the pictures below show the same object."; return; }
  sorry.hidden = true;
  tools.hidden = false;

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  // Positions are 16-bit steps of the mesh's box, normals 8-bit, values 8-bit steps of the map's range (255: unknown).
  const VERTEX = `#version 300 es
    in vec3 position; in vec3 normal; in float value;
    uniform mat4 projection; uniform mat3 turn; uniform vec3 low, span, centre, pan; uniform float away;
    out vec3 n; out vec3 p; out float v; out float known; out float up;
    void main() {
      vec3 q = turn * (low + span * position - centre) + pan;
      n = turn * normal; up = normal.z; p = q - vec3(0.0, 0.0, away); v = value; known = step(value, 0.998);
      gl_Position = projection * vec4(p, 1.0);
    }`;
  // The same studio as the pictures: wrapped key and fill, a sky over a warm floor, a soft edge light, Blinn-Phong.
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 n; in vec3 p; in float v; in float known; in float up;
    uniform vec3 colour; uniform float gloss; uniform bool mapped; uniform sampler2D ramp;
    out vec4 result;
    vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
    float wrapped(float c, float w) { return max((c + w) / (1.0 + w), 0.0) / (1.0 + w); }
    void main() {
      vec3 eye = normalize(-p), N = normalize(n);
      float side = gl_FrontFacing ? 1.0 : -1.0;
      N *= side;
      vec3 albedo = linear(mapped ? (known < 0.999 ? vec3(0.6) : texture(ramp, vec2((v * 255.0 + 0.5) / 255.0, 0.5)).rgb) : colour);
      vec3 key = normalize(vec3(-0.52, 0.62, 0.59)), fill = normalize(vec3(0.8, 0.1, 0.59)), rim = normalize(vec3(0.35, 0.65, -0.67));
      float sky = 0.5 + 0.5 * up * side;
      vec3 light = mix(vec3(0.25, 0.23, 0.21), vec3(0.42, 0.44, 0.48), sky) + wrapped(dot(N, key), 0.25) * vec3(0.80, 0.775, 0.73) + wrapped(dot(N, fill), 0.4) * vec3(0.15, 0.165, 0.19);
      float shine = mapped ? 0.08 : gloss, power = 12.0 + 90.0 * shine;
      float glint = shine * (power + 8.0) / 60.0 * 0.34 * pow(max(dot(N, normalize(eye + key)), 0.0), power);
      float edge = pow(1.0 - max(dot(N, eye), 0.0), 3.0) * max(dot(N, rim) + 0.35, 0.0) * (0.1 + 0.2 * shine);
      vec3 c = light * albedo + glint + edge;
      c = min(c, 0.75) + 0.25 * (1.0 - exp(-max(c - 0.75, 0.0) / 0.25));
      result = vec4(mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)), 1.0);
    }`;

  let program, place, items, ramps;
  const build = () => {
    program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader); gl.attachShader(program, shader);
    }
    ["position", "normal", "value"].forEach((name, index) => gl.bindAttribLocation(program, index, name));
    gl.linkProgram(program); gl.useProgram(program);
    place = new Proxy({}, { get: (_, name) => gl.getUniformLocation(program, name) });
    items = scene.meshes.map(upload);
    ramps = Object.fromEntries(Object.entries(scene.maps).map(([name, map]) => [name, texture(bytes(map.ramp))]));
    gl.enable(gl.DEPTH_TEST);
  };
  const buffer = (target, data) => { const b = gl.createBuffer(); gl.bindBuffer(target, b); gl.bufferData(target, data, gl.STATIC_DRAW); return b; };
  const texture = (rgb) => {
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, rgb.length / 3, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, rgb);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    return gl.getParameter(gl.TEXTURE_BINDING_2D);
  };
  const upload = (mesh) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    for (const [index, data, kind] of [[0, bytes(mesh.positions), gl.UNSIGNED_SHORT], [1, bytes(mesh.normals), gl.BYTE]]) {
      buffer(gl.ARRAY_BUFFER, data); gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, 3, kind, true, kind === gl.BYTE ? 4 : 8, 0);
    }
    const values = Object.fromEntries(Object.entries(mesh.values).map(([name, text]) => [name, buffer(gl.ARRAY_BUFFER, bytes(text))]));
    buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(bytes(mesh.faces).buffer));
    return { ...mesh, array, values };
  };

  // The camera: azimuth 0 looks along +y at the wearer's face, 90 from the wearer's left; elevation 90 from above.
  const start = { azimuth: 35, elevation: 12, zoom: 1, pan: [0, 0] };
  let eye = { ...start }, map = null, withBody = scene.meshes.some((mesh) => mesh.role === "body"), asked = false;
  const HALF = Math.PI / 15, focus = scene.focus;
  const draw = () => {
    asked = false;
    const ratio = Math.min(1.5 * (devicePixelRatio || 1), 2), width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const radius = withBody ? focus.radius_body : focus.radius, aspect = width / height;
    const away = 0.9 * radius / Math.sin(HALF) / Math.min(1, aspect) / eye.zoom, f = 1 / Math.tan(HALF);
    const near = Math.max(away - focus.reach, away * 0.01), far = away + focus.reach;
    gl.uniformMatrix4fv(place.projection, false, [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
    const [a, e] = [eye.azimuth, eye.elevation].map((angle) => angle * Math.PI / 180);
    const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
    gl.uniformMatrix3fv(place.turn, false, [ca, -sa * se, sa * ce, sa, ca * se, -ca * ce, 0, ce, se]);
    gl.uniform3fv(place.centre, withBody ? focus.centre_body : focus.centre);
    gl.uniform3f(place.pan, eye.pan[0] * radius, eye.pan[1] * radius, 0);
    gl.uniform1f(place.away, away);
    for (const item of items) {
      if (item.role === "body" && !withBody) continue;
      gl.bindVertexArray(item.array);
      const mapped = map !== null && map in item.values;
      if (mapped) {
        gl.bindBuffer(gl.ARRAY_BUFFER, item.values[map]);
        gl.enableVertexAttribArray(2); gl.vertexAttribPointer(2, 1, gl.UNSIGNED_BYTE, true, 1, 0);
        gl.bindTexture(gl.TEXTURE_2D, ramps[map]);
      } else gl.disableVertexAttribArray(2);
      gl.uniform1i(place.mapped, mapped);
      gl.uniform3fv(place.low, item.low); gl.uniform3fv(place.span, item.span);
      gl.uniform3fv(place.colour, item.colour); gl.uniform1f(place.gloss, item.gloss);
      gl.drawElements(gl.TRIANGLES, item.count, gl.UNSIGNED_INT, 0);
    }
  };
  const redraw = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
  const change = (turn, tilt, zoom = 1) => {
    eye.azimuth = (eye.azimuth + turn) % 360;
    eye.elevation = Math.max(-90, Math.min(90, eye.elevation + tilt));
    eye.zoom = Math.max(0.3, Math.min(12, eye.zoom * zoom));
    redraw();
  };
  const move = (x, y) => { const s = 2 / (Math.min(canvas.clientWidth, canvas.clientHeight) * eye.zoom); eye.pan = [eye.pan[0] + x * s, eye.pan[1] - y * s]; redraw(); };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.clientX, event.clientY]); });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], x = now[0] - before[0], y = now[1] - before[1];
    if (fingers.size > 1) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const spread = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) + 1;
      change(0, 0, spread(now) / spread(before)); move(x / 2, y / 2);
    } else if (event.shiftKey) move(x, y);
    else change(-x * 0.45, y * 0.45);
    fingers.set(event.pointerId, now);
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); change(0, 0, Math.exp(-event.deltaY * (event.deltaMode ? 0.03 : 0.0012))); }, { passive: false });
  const views = [...tools.querySelectorAll("[data-view]")];
  const look = (button) => { const [azimuth, elevation] = button.dataset.view.split(",").map(Number); eye = { ...start, azimuth, elevation }; redraw(); };
  views.forEach((button) => button.addEventListener("click", () => look(button)));
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const steps = { ArrowLeft: [-10, 0], ArrowRight: [10, 0], ArrowUp: [0, 10], ArrowDown: [0, -10], "+": [0, 0, 1.15], "=": [0, 0, 1.15], "-": [0, 0, 1 / 1.15] };
    if (event.key in steps) change(...steps[event.key]);
    else if (event.key === "0" || event.key === "Home") { eye = { ...start }; redraw(); }
    else if (views[Number(event.key) - 1]) look(views[Number(event.key) - 1]);
    else return;
    event.preventDefault();
  });

  const bodyButton = document.getElementById("show-body");
  bodyButton.hidden = !withBody;
  bodyButton.addEventListener("click", () => { withBody = !withBody; bodyButton.setAttribute("aria-pressed", withBody); redraw(); });
  const show = (name) => {
    map = name;
    for (const button of tools.querySelectorAll("[data-map]")) button.setAttribute("aria-pressed", button.dataset.map === map);
    legend.hidden = map === null;
    if (map !== null) {
      const { title, ticks, ramp } = scene.maps[map], rgb = bytes(ramp);
      document.getElementById("legend-title").textContent = title;
      [...legend.querySelectorAll("div span")].forEach((span, index) => { span.textContent = ticks[index]; });
      const context = legend.querySelector("canvas").getContext("2d"), row = context.createImageData(256, 1);
      for (let x = 0; x < 256; x++) { const from = 3 * Math.min(Math.round(x * (rgb.length / 3 - 1) / 255), rgb.length / 3 - 1); row.data.set([rgb[from], rgb[from + 1], rgb[from + 2], 255], 4 * x); }
      context.putImageData(row, 0, 0);
    }
    redraw();
  };
  for (const button of tools.querySelectorAll("[data-map]")) {
    button.hidden = !(button.dataset.map in scene.maps);
    button.addEventListener("click", () => show(map === button.dataset.map ? null : button.dataset.map));
  }
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => { build(); redraw(); });
  new ResizeObserver(redraw).observe(canvas);
  build();
  // A link such as page.html#wall,back opens with that map and view.
  for (const word of location.hash.slice(1).split(",")) {
    const button = [...tools.querySelectorAll("button")].find((one) => one.textContent.toLowerCase().split(" ")[0] === word && !one.hidden);
    if (button) button.click();
  }
  redraw();
})();

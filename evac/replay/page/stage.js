// What WebGL draws: the building, made anew when the layout changes, and the people of one time.

const WALL_HEIGHT = 0.4;  // Low enough to look over [m].
const DESK_HEIGHT = 0.45;
const SHEETS = [[0.9, 0.25], [1.5, 0.4], [2, 0.25]];  // Smoke above floors: heights [m], and how much each hides.
const EXIT_HEIGHT = 1.3;
const COVER = { floor: 0.3, solid: 0.45 };  // How much what is above hides of what is below.
const UNITS = { bodies: 0, tints: 1, values: 2, scale: 3 };  // Of textures.
const BYTES = ["RGBA8", "RGBA", "UNSIGNED_BYTE"];
const KINDS = ["floor", "flight", "landing"];

const SMOOTH = 1500;  // So many people have smooth edges even where there is no graphics processor.

function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const known = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = known ? gl.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

class Stage {
  constructor(canvas, people) {
    const antialias = people <= SMOOTH || !drawsInSoftware();
    const gl = canvas.getContext("webgl2", { antialias, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("The replay requires WebGL 2, which this browser lacks. Use a current browser.");
    Object.assign(this, { canvas, gl, meshes: {} });
    [this.floor, this.solid, this.glow, this.person, this.shadow] = this.programs = [FLOOR, SOLID, GLOW, PERSON, SHADOW].map((code) => this.program(code));
    this.crowd = gl.createVertexArray();
    for (const name of Object.keys(UNITS)) this.texture(name);
  }

  program([vertex, fragment]) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const setters = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
      const { name, type } = gl.getActiveUniform(program, k), place = gl.getUniformLocation(program, name);
      const way = { [gl.FLOAT]: "uniform1f", [gl.FLOAT_VEC3]: "uniform3fv" }[type] ?? "uniform1i";
      let last = null;
      setters[name.replace("[0]", "")] = type === gl.FLOAT_MAT4 ? (value) => gl.uniformMatrix4fv(place, false, value)
                                                                : (value) => { if (value !== last) gl[way](place, last = value); };
    }
    return { program, setters };
  }

  // Makes a texture, which stays bound to its unit.
  texture(name) {
    const { gl } = this, filter = name === "scale" ? gl.LINEAR : gl.NEAREST;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, filter], [gl.TEXTURE_MAG_FILTER, filter],
                                [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, key, value);
    }
  }

  fill(name, width, height, [stored, given, type], values) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl[stored], width, height, 0, gl[given], gl[type], values);
  }

  mesh(name, values, sizes) {
    const { gl } = this, old = this.meshes[name];
    if (old) { gl.deleteBuffer(old.buffer); gl.deleteVertexArray(old.array); }
    const array = gl.createVertexArray(), stride = sizes.reduce((a, b) => a + b);
    gl.bindVertexArray(array);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW);
    let offset = 0;
    sizes.forEach((size, index) => {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, size, gl.FLOAT, false, 4 * stride, 4 * offset);
      offset += size;
    });
    gl.bindVertexArray(null);
    this.meshes[name] = { array, buffer, count: values.length / stride };
  }

  // Makes the meshes of everything that the layout shows, storey by storey.
  build(layout, density, state, colours) {
    layout.storeys.forEach((_, storey) => {
      this.mesh(`floor ${storey}`, floorMesh(layout, storey, density), [3, 2, 2]);
      this.mesh(`solid ${storey}`, solidMesh(layout, storey), [3, 4]);
      this.mesh(`glow ${storey}`, glowMesh(layout, storey, state, colours), [3, 4]);
    });
  }

  setScale(colours) { this.fill("scale", 256, 1, BYTES, new Uint8Array(colours.buffer)); }

  // Hands over what the layer on the floors shows: bytes at the nodes of the grids, between which it may be smooth.
  setLayer({ width, height }, bytes, isSmooth) {
    const { gl } = this, filter = isSmooth ? gl.LINEAR : gl.NEAREST;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.fill("values", width, height, ["R8", "RED", "UNSIGNED_BYTE"], bytes);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  }

  // Hands the people over as two textures, whose last row may end with nobody.
  setPeople({ bodies, tints, width, count }) {
    const height = Math.max(1, Math.ceil(count / width));
    this.fill("bodies", width, height, ["RGBA32F", "RGBA", "FLOAT"], bodies);
    this.fill("tints", width, height, BYTES, tints);
  }

  // Draws one storey over the other from below, so that floors and walls are translucent. `look` has the colours of the
  // theme, whether there is a layer on the floors, whether it is smoke, and whether there are shadows.
  draw(camera, people, look) {
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...look.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.setPeople(people);
    const { matrix: view, right, up, isFlat } = camera, { tallest, marked } = people;
    const common = { ...UNITS, view, right, up, tallest, marked, ...look };
    for (const program of this.programs) this.use(program, common);
    let isOpaque = true;
    people.parts.forEach((part, storey) => {
      if (!this.meshes[`floor ${storey}`].count) return;
      gl.depthMask(false);
      this.use(this.floor, { cover: isOpaque ? 1 : COVER.floor, lift: 0, sheet: 0 });
      this.show(`floor ${storey}`);
      this.drawPeople(part, look.shadows);
      this.use(this.solid, { cover: isOpaque ? 1 : COVER.solid });
      this.show(`solid ${storey}`);
      if (isFlat) this.show(`solid ${storey}`, gl.LINES);  // walls thinner than a pixel
      gl.depthMask(false);
      this.use(this.glow);
      this.show(`glow ${storey}`);
      if (look.isSmoky && !isFlat) for (const [lift, sheet] of SHEETS) {
        this.use(this.floor, { lift, sheet });
        this.show(`floor ${storey}`);
      }
      gl.depthMask(true);
      isOpaque = isFlat;
    });
    gl.depthMask(false);
    this.use(this.glow);
    this.show("cars");
    this.show("paths", gl.LINES);
    this.show("track");
    this.show("measured");
    gl.depthMask(true);
  }

  drawPeople([from, count], hasShadows) {
    const { gl } = this;
    gl.bindVertexArray(this.crowd);
    if (hasShadows) {
      this.use(this.shadow);
      gl.drawArrays(gl.TRIANGLES, 6 * from, 6 * count);
    }
    gl.depthMask(true);
    this.use(this.person);
    gl.disable(gl.BLEND);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.drawArrays(gl.TRIANGLES, 6 * from, 6 * count);
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.enable(gl.BLEND);
  }

  // Draws with a program from now on, of which some of the uniforms are given.
  use({ program, setters }, values = {}) {
    this.gl.useProgram(program);
    for (const name in values) setters[name]?.(values[name]);
  }

  show(name, shapes = this.gl.TRIANGLES) {
    const mesh = this.meshes[name];
    if (!mesh?.count) return;
    this.gl.bindVertexArray(mesh.array);
    this.gl.drawArrays(shapes, 0, mesh.count);
  }
}

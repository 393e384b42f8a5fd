// What WebGL draws: the building, made anew when the layout changes, and the people of one time.

const WALL_HEIGHT = 0.4;  // Low enough to look over [m].
const DESK_HEIGHT = 0.45;
const EXIT_HEIGHT = 1.3;
const COVER = { floor: 0.3, solid: 0.45 };  // How much what is above hides of what is below.
const KINDS = ["floor", "flight", "landing"];

const SMOOTH = 2000;  // So many people have smooth edges even where there is no graphics processor.

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
    if (!gl) throw new Error("This browser has no WebGL 2, which the replay is drawn with. Use a current browser.");
    this.canvas = canvas;
    this.gl = gl;
    this.floor = this.program(FLOOR);
    this.solid = this.program(SOLID);
    this.glow = this.program(GLOW);
    this.person = this.program(PERSON);
    this.shadow = this.program(SHADOW);
    this.meshes = {};
    this.crowd = gl.createVertexArray();
    this.bodies = this.texture(gl.NEAREST);
    this.tints = this.texture(gl.NEAREST);
    this.atlas = this.texture(gl.LINEAR);
    this.scale = this.texture(gl.LINEAR);
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
    const places = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
      const name = gl.getActiveUniform(program, k).name.replace("[0]", "");
      places[name] = gl.getUniformLocation(program, name);
    }
    return { program, places };
  }

  buffer(data) {
    const { gl } = this, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return buffer;
  }

  texture(filter) {
    const { gl } = this, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, filter], [gl.TEXTURE_MAG_FILTER, filter],
                                [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, key, value);
    }
    return texture;
  }

  mesh(name, values, sizes) {
    const { gl } = this, old = this.meshes[name];
    if (old) { gl.deleteBuffer(old.buffer); gl.deleteVertexArray(old.array); }
    const array = gl.createVertexArray(), stride = sizes.reduce((a, b) => a + b);
    gl.bindVertexArray(array);
    const buffer = this.buffer(new Float32Array(values));
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
  build(layout, density, closed, marks, colours) {
    layout.storeys.forEach((_, storey) => {
      this.mesh(`floor ${storey}`, floorMesh(layout, storey, density), [3, 2, 2]);
      this.mesh(`solid ${storey}`, solidMesh(layout, storey), [3, 4]);
      this.mesh(`glow ${storey}`, glowMesh(layout, storey, closed, marks, colours), [3, 4]);
    });
  }

  setScale(colours) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.scale);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(colours.buffer));
  }

  // Hands over what the layer on the floors shows: bytes at the nodes of the grids, between which it may be smooth.
  setLayer({ width, height }, bytes, isSmooth) {
    const { gl } = this, filter = isSmooth ? gl.LINEAR : gl.NEAREST;
    gl.bindTexture(gl.TEXTURE_2D, this.atlas);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, width, height, 0, gl.RED, gl.UNSIGNED_BYTE, bytes);
  }

  // Draws one storey over the other from below, so that floors and walls are translucent. `look` has the colours of the
  // theme, whether there is a layer on the floors, and whether there are shadows.
  draw(camera, people, look) {
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...look.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.setPeople(people);
    let isLowest = true;
    people.parts.forEach((part, storey) => {
      if (!this.meshes[`floor ${storey}`].count) return;
      this.drawFloors(storey, camera, look, isLowest || camera.isFlat ? 1 : COVER.floor);
      this.drawPeople(part, camera, people, look);
      this.use(this.solid, camera);
      gl.uniform3fv(this.solid.places.solids, look.solids.flat());
      gl.uniform1f(this.solid.places.cover, isLowest || camera.isFlat ? 1 : COVER.solid);
      this.show(`solid ${storey}`);
      gl.depthMask(false);
      this.use(this.glow, camera);
      this.show(`glow ${storey}`);
      gl.depthMask(true);
      isLowest = false;
    });
    gl.depthMask(false);
    this.use(this.glow, camera);
    this.show("track");
    this.show("measured");
    gl.depthMask(true);
  }

  drawFloors(storey, camera, look, cover) {
    const { gl, floor: { places } } = this;
    this.use(this.floor, camera);
    gl.uniform3fv(places.floors, look.floors.flat());
    gl.uniform1f(places.layer, look.layer ? 1 : 0);
    gl.uniform1f(places.cover, cover);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.scale);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.atlas);
    gl.uniform1i(places.values, 0);
    gl.uniform1i(places.scale, 1);
    gl.depthMask(false);
    this.show(`floor ${storey}`);
    gl.depthMask(true);
  }

  // Hands the people over as two textures, whose rows may end with nobody.
  setPeople({ bodies, tints, width }) {
    const { gl } = this, height = bodies.length / 4 / width;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.bodies);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, bodies);
    gl.bindTexture(gl.TEXTURE_2D, this.tints);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, tints);
  }

  drawPeople([from, count], camera, people, look) {
    const { gl } = this;
    gl.bindVertexArray(this.crowd);
    if (look.shadows) {
      this.usePeople(this.shadow, camera, people);
      gl.uniform3fv(this.shadow.places.mark, look.mark);
      gl.uniform1f(this.shadow.places.widen, look.widen);
      gl.depthMask(false);
      gl.drawArrays(gl.TRIANGLES, 6 * from, 6 * count);
      gl.depthMask(true);
    }
    this.usePeople(this.person, camera, people);
    gl.uniform3fv(this.person.places.rim, look.rim);
    gl.uniform3fv(this.person.places.heads, HEADS.flatMap((head) => unit(head ?? HEADS[1])));
    gl.disable(gl.BLEND);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.drawArrays(gl.TRIANGLES, 6 * from, 6 * count);
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.enable(gl.BLEND);
    gl.bindVertexArray(null);
  }

  usePeople(program, camera, people) {
    const { gl } = this;
    this.use(program, camera);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.tints);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.bodies);
    gl.uniform1i(program.places.bodies, 0);
    gl.uniform1i(program.places.tints, 1);
    gl.uniform1f(program.places.tallest, people.tallest);
    if (program.places.marked) gl.uniform1i(program.places.marked, people.marked);
  }

  use({ program, places }, camera) {
    const { gl } = this;
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.view, false, camera.matrix);
    if (places.right) gl.uniform3fv(places.right, camera.right);
    if (places.up) gl.uniform3fv(places.up, camera.up);
  }

  show(name) {
    const mesh = this.meshes[name];
    if (!mesh || !mesh.count) return;
    this.gl.bindVertexArray(mesh.array);
    this.gl.drawArrays(this.gl.TRIANGLES, 0, mesh.count);
    this.gl.bindVertexArray(null);
  }
}

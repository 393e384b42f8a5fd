// Shaders. Lengths are metres; `eye` is the eye (w = 1), or the direction towards it where rays are parallel (w = 0).

const HEAD = `#version 300 es
precision highp float;
uniform mat4 view;
uniform vec4 eye;
uniform vec3 right, up;
`;

const FLOOR = [HEAD + `
layout(location = 0) in vec3 place;
layout(location = 1) in vec2 texel;
layout(location = 2) in vec2 tone;  // kind of the level, true height
out vec2 cell;
out vec2 shade;
void main() {
  cell = texel;
  shade = tone;
  gl_Position = view * vec4(place, 1.0);
}`, HEAD + `
uniform vec3 floors[3];
uniform sampler2D density, scale;
uniform float layer;
in vec2 cell;
in vec2 shade;
out vec4 colour;
void main() {
  int kind = int(shade.x + 0.5);
  vec3 base = floors[kind];
  if (kind == 1) {  // treads of a flight
    float tread = shade.y / 0.175, wide = fwidth(tread);
    float edge = smoothstep(0.0, 0.12 + wide, fract(tread)) ;
    base *= mix(mix(0.80, 1.0, edge), 0.95, clamp(1.6 * wide - 0.3, 0.0, 1.0));
  }
  float value = texture(density, cell).r;
  vec3 heat = texture(scale, vec2(value * 0.996 + 0.002, 0.5)).rgb;
  colour = vec4(mix(base, heat, layer * smoothstep(0.01, 0.12, value) * 0.88), 1.0);
}`];

const SOLID = [HEAD + `
layout(location = 0) in vec3 place;
layout(location = 1) in vec4 surface;  // normal, kind: 0 wall, 1 top of a wall, 2 furniture
uniform vec3 solids[3];
out vec3 tint;
void main() {
  float light = 0.72 + 0.28 * max(0.0, dot(surface.xyz, normalize(vec3(-0.4, -0.65, 0.65))));
  tint = solids[int(surface.w + 0.5)] * light;
  gl_Position = view * vec4(place, 1.0);
}`, HEAD + `
in vec3 tint;
out vec4 colour;
void main() { colour = vec4(tint, 1.0); }`];

const GLOW = [HEAD + `
layout(location = 0) in vec3 place;
layout(location = 1) in vec4 tint;
out vec4 shade;
void main() {
  shade = tint;
  gl_Position = view * vec4(place, 1.0);
}`, HEAD + `
in vec4 shade;
out vec4 colour;
void main() { colour = vec4(shade.rgb * shade.a, shade.a); }`];

// People are an ellipsoid of the body's radius and a sphere on it, met by the ray of each pixel.
const PERSON = [HEAD + `
layout(location = 0) in vec2 corner;
layout(location = 1) in vec4 body;  // place, radius
layout(location = 2) in vec4 tint;
out vec3 at;
flat out vec4 who;
flat out vec3 shade;
void main() {
  float flatness = length(up.xy);
  vec2 size = vec2(body.w * 1.08, body.w * (1.0 - flatness * flatness) * 1.08 + body.w * 0.1 + 0.87 * flatness);
  at = body.xyz + vec3(0.0, 0.0, 0.84) + size.x * corner.x * right + size.y * corner.y * up;
  who = body;
  shade = tint.rgb;
  gl_Position = view * vec4(at, 1.0);
}`, HEAD + `
in vec3 at;
flat in vec4 who;
flat in vec3 shade;
out vec4 colour;
// Nearest distance of the ray to the centre in units of the surface, and where it enters.
vec2 meet(vec3 from, vec3 along) {
  float a = dot(along, along), b = dot(from, along), c = dot(from, from);
  float off = c - b * b / a;
  return vec2(sqrt(max(off, 0.0)), (-b - sqrt(max((1.0 - off) * a, 0.0))) / a);
}
void main() {
  vec3 along = eye.w > 0.5 ? normalize(at - eye.xyz) : -eye.xyz;
  vec3 from = at - 3.0 * along;
  float r = who.w, h = 0.60 * r;
  vec3 size = vec3(r, r, 0.70);
  vec3 trunk = who.xyz + vec3(0.0, 0.0, 0.70), head = who.xyz + vec3(0.0, 0.0, 1.40 + 0.55 * h);
  vec2 a = meet((from - trunk) / size, along / size), b = meet((from - head) / h, along / h);
  float wide = fwidth(min(a.x, b.x)) + 1e-5;
  float cover = clamp((1.0 - min(a.x, b.x)) / wide + 0.5, 0.0, 1.0);
  if (cover <= 0.0) discard;
  bool isHead = b.x < 1.0 && (a.x >= 1.0 || b.y < a.y);
  float way = isHead ? b.y : (a.x < 1.0 ? a.y : (b.x < a.x ? b.y : a.y));
  vec3 hit = from + way * along;
  vec3 normal = normalize(isHead ? hit - head : (hit - trunk) / (size * size));
  float light = 0.66 + 0.40 * max(0.0, dot(normal, normalize(0.9 * up - 0.5 * right + vec3(0.0, 0.0, 0.9))));
  light += 0.12 * max(0.0, -dot(normal, along));
  vec3 tone = isHead ? mix(shade, vec3(1.0), 0.28) : shade;
  colour = vec4(tone * light, cover);
  vec4 clip = view * vec4(hit, 1.0);
  gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
}`];

// A soft shadow on the floor under each person, and a ring around whoever is selected.
const SHADOW = [HEAD + `
layout(location = 0) in vec2 corner;
layout(location = 1) in vec4 body;
layout(location = 2) in vec4 tint;
uniform float widen;
out vec2 off;
flat out float ring;
void main() {
  ring = tint.a;
  off = corner;
  float size = body.w * (ring < 0.5 ? 2.4 * widen : 1.5);
  gl_Position = view * vec4(body.xyz + vec3(corner * size, 0.02), 1.0);
}`, HEAD + `
uniform vec3 mark;
in vec2 off;
flat in float ring;
out vec4 colour;
void main() {
  float away = length(off);
  if (ring < 0.5) {
    float band = smoothstep(0.40, 0.50, away) * (1.0 - smoothstep(0.88, 0.98, away));
    float glow = 0.35 * (1.0 - smoothstep(0.0, 1.0, away));
    float share = max(band, glow);
    colour = vec4(mark * share, share);
  } else {
    colour = vec4(0.0, 0.0, 0.0, 0.30 * (1.0 - smoothstep(0.30, 1.0, away)));
  }
}`];

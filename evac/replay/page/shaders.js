// Shaders. Lengths are metres.

const HEAD = `#version 300 es
precision highp float;
uniform mat4 view;
uniform vec3 right, up;
`;

// Nothing is drawn beyond a box.
const CLIP = `
uniform vec3 low, high;
in vec3 spot;
void clip() { if (any(lessThan(spot, low)) || any(greaterThan(spot, high))) discard; }
`;

// Six vertices for each person, who is a texel of two textures. Software draws this much faster than instances.
const FIND = `
precision highp sampler2D;
uniform sampler2D bodies, tints;
uniform float tallest;
uniform int marked;
vec4 body;  // place, radius
int look;  // which marks the head and the belt have
vec4 tint;
float tall;  // height
bool isMarked;
vec2 corner;
void find() {
  int person = gl_VertexID / 6, turn = gl_VertexID % 6, width = textureSize(bodies, 0).x;
  ivec2 texel = ivec2(person % width, person / width);
  body = texelFetch(bodies, texel, 0);
  look = int(body.w / 10.0);
  body.w -= 10.0 * float(look);
  tint = texelFetch(tints, texel, 0);
  tall = tint.a * tallest;
  isMarked = person == marked;
  corner = vec2(turn == 1 || turn == 2 || turn == 4 ? 1.0 : -1.0, turn == 2 || turn == 4 || turn == 5 ? 1.0 : -1.0);
}
`;

const FLOOR = [HEAD + `
layout(location = 0) in vec3 place;
out vec3 spot;
layout(location = 1) in vec2 texel;
layout(location = 2) in vec2 tone;  // kind of the level, true height
uniform float lift;
out vec2 cell;
out vec2 shade;
void main() {
  cell = texel;
  shade = tone;
  spot = place;
  gl_Position = view * vec4(place + vec3(0.0, 0.0, lift), 1.0);
}`, HEAD + CLIP + `
uniform vec3 floors[3];
uniform sampler2D values, scale;
uniform float layer, cover, sheet, limit;
in vec2 cell;
in vec2 shade;
out vec4 colour;
void main() {
  clip();
  int kind = int(shade.x + 0.5);
  vec3 base = floors[kind];
  if (kind == 1) {  // treads of a flight
    float tread = shade.y / 0.175, wide = fwidth(tread);
    float edge = smoothstep(0.0, 0.12 + wide, fract(tread)) ;
    base *= mix(mix(0.80, 1.0, edge), 0.95, clamp(1.6 * wide - 0.3, 0.0, 1.0));
  }
  float share = cover;
  if (layer > 0.5) {
    float value = texture(values, cell).r;
    vec4 heat = texture(scale, vec2(value * 0.996 + 0.002, 0.5));
    if (sheet > 0.0) {  // of smoke, above the floor
      colour = vec4(heat.rgb, 1.0) * heat.a * sheet;
      return;
    }
    base = mix(base, heat.rgb, heat.a);
    share = max(cover, heat.a);
    float line = limit < 0.0 ? 0.0 : 1.0 - smoothstep(1.0, 2.0, abs(value - limit) / max(fwidth(value), 1e-5));
    base = mix(base, vec3(0.80, 0.10, 0.08), line);
    share = max(share, line);
  }
  colour = vec4(base * share, share);
}`];

const SOLID = [HEAD + `
layout(location = 0) in vec3 place;
out vec3 spot;
layout(location = 1) in vec4 surface;  // normal, kind: 0 wall, 1 top of a wall, 2 furniture
uniform vec3 solids[3];
out vec3 tint;
void main() {
  float light = 0.72 + 0.28 * max(0.0, dot(surface.xyz, normalize(vec3(-0.4, -0.65, 0.65))));
  tint = solids[int(surface.w + 0.5)] * light;
  spot = place;
  gl_Position = view * vec4(place, 1.0);
}`, HEAD + CLIP + `
uniform float cover;
in vec3 tint;
out vec4 colour;
void main() { clip(); colour = vec4(tint * cover, cover); }`];

const GLOW = [HEAD + `
layout(location = 0) in vec3 place;
out vec3 spot;
layout(location = 1) in vec4 tint;
out vec4 shade;
void main() {
  shade = tint;
  spot = place;
  gl_Position = view * vec4(place, 1.0);
}`, HEAD + CLIP + `
in vec4 shade;
out vec4 colour;
void main() { clip(); colour = vec4(shade.rgb * shade.a, shade.a); }`];

// People are a head, a trunk, arms and legs, as outlines that face the eye and are shaded as if round; from above, a disc of the body's radius
// and a head. Depth is that of the upright axis, so that nobody stands out of a wall or sinks into the floor.
const PERSON = [HEAD + FIND + `
out vec2 at;  // from half the height
flat out vec4 size;  // radius, height; how much of a height, and of a depth, is seen
flat out vec3 shade;
flat out vec3 hat;
flat out vec3 belt;
uniform vec3 marks[3];
void main() {
  find();
  hat = marks[look % 3];
  belt = marks[look / 3];
  size = vec4(body.w, tall, length(up.z), length(up.xy));
  float reach = size.x * max(0.3, size.w), high = 0.5 * tall * size.z;
  at = vec2(1.06 * size.x * corner.x, corner.y > 0.0 ? max(high, 0.3 * tall * size.z + reach) * 1.04 : -high - 1.04 * reach);
  shade = tint.rgb;
  gl_Position = view * vec4(body.xyz + vec3(0.0, 0.0, 0.5 * tall) + at.x * right + at.y * up, 1.0);
  vec4 axis = view * vec4(body.xyz + vec3(0.0, 0.0, corner.y > 0.0 ? tall : 0.05), 1.0);
  gl_Position.z = axis.z / axis.w * gl_Position.w;
}`, HEAD + `
in vec2 at;
flat in vec4 size;
flat in vec3 shade;
flat in vec3 hat, belt;  // negative for none
uniform vec3 rim;  // So that people of any colour are told from the floor.
out vec4 colour;
// From the middle (0) to the rim (1) of an upright part between two shares of the height, of a half width and a depth.
vec2 within(vec2 from, float low, float high, vec2 reach) {
  float scale = size.y * size.z;
  return vec2(from.x, from.y - clamp(from.y, (low - 0.5) * scale, (high - 0.5) * scale)) / reach;
}
void main() {
  float r = size.x, tall = size.y, flank = abs(at.x), share = at.y / max(0.05, tall * size.z) + 0.5;
  float skull = min(0.078 * tall, 0.6 * r), above = smoothstep(0.8, 1.0, size.w);
  float breadth = r * mix(mix(0.68, 0.9, smoothstep(0.5, 0.72, share)) * (1.0 - 0.3 * smoothstep(0.74, 0.86, share)), 0.98, above);
  vec2 head = within(at, 1.0 - skull / tall, 1.0 - skull / tall, vec2(0.85 * skull, skull));
  vec2 trunk = within(at, 0.5, 0.8, vec2(breadth, r * max(0.3, smoothstep(0.3, 1.0, size.w))));
  vec2 arm = within(vec2(flank - 0.82 * r, at.y), 0.44, 0.75, vec2(0.17 * r, 0.25 * r));
  vec2 leg = within(vec2(flank - 0.33 * r, at.y), 0.03, 0.5, vec2(0.29 * r, 0.2 * r));
  vec4 part = vec4(dot(head, head), dot(trunk, trunk), dot(arm, arm), dot(leg, leg));
  float nearest = min(min(part.x, part.y), min(part.z, part.w));
  float cover = clamp((1.0 - nearest) / (fwidth(nearest) + 1e-4) + 0.5, 0.0, 1.0);
  if (cover <= 0.0) discard;
  bool isHead = part.x < 1.0, isTrunk = !isHead && part.y < 1.0, isLeg = !isHead && !isTrunk && part.w < part.z;
  vec2 n = isHead ? head : isTrunk ? trunk : isLeg ? leg : arm;
  float facing = sqrt(max(0.0, 1.0 - dot(n, n)));
  float light = 0.66 + 0.40 * max(0.0, dot(vec3(n, facing), vec3(-0.36, 0.66, 0.66)));
  vec3 tone = isHead ? mix(shade, vec3(1.0), 0.3) : isLeg ? 0.62 * shade : shade;
  if (hat.r >= 0.0 && isHead) tone = hat;
  if (belt.r >= 0.0 && !isHead && abs(share - 0.58) < 0.07) tone = belt;
  colour = vec4(mix(tone * light, rim, 0.75 * smoothstep(0.6, 1.0, nearest)), cover);
}`];

// A soft shadow on the floor under each person, and a ring around whoever is selected.
const SHADOW = [HEAD + FIND + `
uniform float widen;
out vec2 off;
flat out float ring;
void main() {
  find();
  ring = isMarked ? 0.0 : 1.0;
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

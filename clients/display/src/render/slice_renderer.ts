// Draws a plane through volumes: linear interpolation, window and level, a second image blended over the first, and
// labels in their colours.
//
// The interpolation is done in the shader, in 32-bit floats from the exact voxels: a graphics card's own filter has 8 bits
// for the position between two voxels, which is visible at steep edges.
import type { Plane } from "../geometry/planes.ts";
import type { Window } from "../image/volume.ts";
import { Program } from "./program.ts";
import type { SamplerType, VolumeTexture } from "./volume_texture.ts";

// A rectangle of the canvas in its pixels, from the lower left corner.
export interface Viewport {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

export interface SliceImage {
  readonly texture: VolumeTexture;
  readonly window: Window;
}

export interface Labels {
  readonly texture: VolumeTexture;
  readonly colours: WebGLTexture; // one texel per value: see labelColours()
  readonly count: number;
  readonly opacity: number;
}

export interface SliceLayers {
  readonly image: SliceImage;
  readonly second?: SliceImage & { readonly blend: number; readonly tint: readonly [number, number, number] };
  readonly labels?: Labels;
}

const kVertex = `#version 300 es
layout(location = 0) in vec2 a_position;
uniform vec2 u_half_mm;
uniform vec3 u_centre, u_right, u_up;
uniform mat4 u_view;
out vec3 v_image;
void main() {
  v_image = u_centre + a_position.x * u_half_mm.x * u_right + a_position.y * u_half_mm.y * u_up;
  gl_Position = u_view[3][3] == 0.0 ? vec4(a_position, 0.0, 1.0) : u_view * vec4(v_image, 1.0);
}`;

const kCommon = `
precision highp float;
precision highp int;
in vec3 v_image;
out vec4 colour;
// As ITK: the image reaches half a voxel beyond the outer centres, where the outer values hold.
bool inside(vec3 p, ivec3 size) {
  return all(greaterThanEqual(p, vec3(-0.5))) && all(lessThanEqual(p, vec3(size) - 0.5));
}
float windowed(float value, vec2 low_scale) { return clamp((value - low_scale.x) * low_scale.y, 0.0, 1.0); }
`;

const interpolation = (name: string, sampler: SamplerType) => `
uniform highp ${sampler} ${name};
uniform mat4x3 ${name}_T_index_image;
float ${name}_linear(vec3 p, ivec3 size) {
  vec3 q = clamp(p, vec3(0.0), vec3(size - 1));
  ivec3 low = min(ivec3(q), max(size - 2, 0));
  ivec3 high = min(low + 1, size - 1);
  vec3 t = q - vec3(low);
  float a = mix(float(texelFetch(${name}, low, 0).r), float(texelFetch(${name}, ivec3(high.x, low.yz), 0).r), t.x);
  float b = mix(float(texelFetch(${name}, ivec3(low.x, high.y, low.z), 0).r), float(texelFetch(${name}, ivec3(high.xy, low.z), 0).r), t.x);
  float c = mix(float(texelFetch(${name}, ivec3(low.xy, high.z), 0).r), float(texelFetch(${name}, ivec3(high.x, low.y, high.z), 0).r), t.x);
  float d = mix(float(texelFetch(${name}, ivec3(low.x, high.yz), 0).r), float(texelFetch(${name}, high, 0).r), t.x);
  return mix(mix(a, b, t.y), mix(c, d, t.y), t.z);
}`;

function fragment(image: SamplerType, second: SamplerType | null, labels: SamplerType | null): string {
  return `#version 300 es
${kCommon}
${interpolation("u_image", image)}
uniform vec2 u_image_window;
${second ? interpolation("u_second", second) : ""}
uniform vec2 u_second_window;
uniform vec3 u_second_tint;
uniform float u_second_blend;
${labels ? `uniform highp ${labels} u_labels; uniform mat4x3 u_labels_T_index_image;` : ""}
uniform highp sampler2D u_colours;
uniform int u_colour_count;
uniform float u_label_opacity;
uniform float u_air; // values up to this are not drawn in space
uniform float u_outside; // opacity of what is outside the image, and of air
void main() {
  ivec3 size = textureSize(u_image, 0);
  vec3 p = u_image_T_index_image * vec4(v_image, 1.0);
  bool within = inside(p, size);
  float value = within ? u_image_linear(p, size) : 0.0;
  vec3 rgb = vec3(within ? windowed(value, u_image_window) : 0.0);
  if (u_outside == 0.0 && value <= u_air) within = false;
  ${
    second
      ? `ivec3 size2 = textureSize(u_second, 0);
  vec3 p2 = u_second_T_index_image * vec4(v_image, 1.0);
  if (inside(p2, size2)) {
    rgb = mix(rgb, u_second_tint * windowed(u_second_linear(p2, size2), u_second_window), u_second_blend);
    within = true;
  }`
      : ""
  }
  ${
    labels
      ? `ivec3 size3 = textureSize(u_labels, 0);
  vec3 p3 = u_labels_T_index_image * vec4(v_image, 1.0);
  if (inside(p3, size3)) {
    int value = int(texelFetch(u_labels, clamp(ivec3(floor(p3 + 0.5)), ivec3(0), size3 - 1), 0).r);
    if (value > 0 && value < u_colour_count) {
      vec4 label = texelFetch(u_colours, ivec2(value % 1024, value / 1024), 0);
      rgb = mix(rgb, label.rgb, label.a * u_label_opacity);
    }
  }`
      : ""
  }
  float alpha = within ? 1.0 : u_outside;
  if (alpha == 0.0) discard;
  colour = vec4(rgb, 1.0);
}`;
}

export class SliceRenderer {
  private readonly programs = new Map<string, Program>();
  private readonly quad: WebGLVertexArrayObject;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.quad = gl.createVertexArray();
    gl.bindVertexArray(this.quad);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
  }

  // Fills a viewport with the plane, whose centre is in the middle. The image is black outside.
  draw(layers: SliceLayers, plane: Plane, mm_per_pixel: number, viewport: Viewport): void {
    const { gl } = this;
    gl.viewport(viewport.x, viewport.y, viewport.width, viewport.height);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    const half: [number, number] = [(viewport.width * mm_per_pixel) / 2, (viewport.height * mm_per_pixel) / 2];
    this.drawQuad(layers, plane, half, null);
  }

  // The same as a rectangle in space, seen through a camera. Nothing is drawn outside the image, nor where its value is at
  // most `air`, so that a plane does not hide what is behind the head.
  drawInSpace(
    layers: SliceLayers,
    plane: Plane,
    half_mm: readonly [number, number],
    view: Float32Array,
    air: number,
  ): void {
    this.drawQuad(layers, plane, half_mm, view, air);
  }

  private drawQuad(
    layers: SliceLayers,
    plane: Plane,
    half_mm: readonly [number, number],
    view: Float32Array | null,
    air = Number.NaN,
  ): void {
    const { gl } = this;
    const program = this.programFor(layers);
    program.use();
    gl.uniform2f(program.at("u_half_mm"), half_mm[0], half_mm[1]);
    gl.uniform3fv(program.at("u_centre"), plane.centre);
    gl.uniform3fv(program.at("u_right"), plane.right);
    gl.uniform3fv(program.at("u_up"), plane.up);
    gl.uniformMatrix4fv(program.at("u_view"), false, view ?? kNoView);
    gl.uniform1f(program.at("u_outside"), view ? 0 : 1);
    gl.uniform1f(program.at("u_air"), air);
    this.bind(program, "u_image", 0, layers.image);
    if (layers.second) {
      this.bind(program, "u_second", 1, layers.second);
      gl.uniform1f(program.at("u_second_blend"), layers.second.blend);
      gl.uniform3fv(program.at("u_second_tint"), layers.second.tint);
    }
    if (layers.labels) {
      layers.labels.texture.bind(2);
      gl.uniform1i(program.at("u_labels"), 2);
      gl.uniformMatrix4x3fv(program.at("u_labels_T_index_image"), false, columns(layers.labels.texture.T_index_image));
      gl.activeTexture(gl.TEXTURE3);
      gl.bindTexture(gl.TEXTURE_2D, layers.labels.colours);
      gl.uniform1i(program.at("u_colours"), 3);
      gl.uniform1i(program.at("u_colour_count"), layers.labels.count);
      gl.uniform1f(program.at("u_label_opacity"), layers.labels.opacity);
    }
    gl.bindVertexArray(this.quad);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  private bind(program: Program, name: string, unit: number, image: SliceImage): void {
    const { gl } = this;
    image.texture.bind(unit);
    gl.uniform1i(program.at(name), unit);
    gl.uniformMatrix4x3fv(program.at(`${name}_T_index_image`), false, columns(image.texture.T_index_image));
    const { window, level } = image.window;
    gl.uniform2f(program.at(`${name}_window`), level - window / 2, 1 / Math.max(window, 1e-6));
  }

  private programFor(layers: SliceLayers): Program {
    const types = [layers.image.texture, layers.second?.texture, layers.labels?.texture].map((t) => t?.sampler ?? null);
    const key = types.join(" ");
    let program = this.programs.get(key);
    if (!program) {
      program = new Program(this.gl, kVertex, fragment(types[0] as SamplerType, types[1], types[2]));
      this.programs.set(key, program);
    }
    return program;
  }
}

const kNoView = new Float32Array(16);

// Twelve numbers row by row, as GLSL's mat4x3 wants them: four columns of three.
function columns(m: readonly number[]): Float32Array {
  return new Float32Array([m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10], m[3], m[7], m[11]]);
}

// Colours of label values, 0 being no label. `colours` has red, green, blue (0 to 1) per value; a missing one is not drawn.
export function labelColours(
  gl: WebGL2RenderingContext,
  colours: ReadonlyMap<number, readonly [number, number, number]>,
): { texture: WebGLTexture; count: number } {
  const count = Math.max(0, ...colours.keys()) + 1;
  const height = Math.ceil(count / 1024);
  const texels = new Uint8Array(4 * 1024 * height);
  for (const [value, rgb] of colours) texels.set([...rgb.map((c) => Math.round(255 * c)), 255], 4 * value);
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1024, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, texels);
  return { texture, count };
}

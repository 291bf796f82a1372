// Pictures of surfaces that do not change between draws, with their depths. Where WebGL is software, the vertices of a
// head's surfaces cost more than all else in space; put from here, a surface costs one look at each of its pixels.
//
// A layer keeps colour and depth of its nearest surface in each pixel. The depths are what lets planes and tools, which
// move, hide it or be hidden by it.
import { Program } from "./program.ts";
import type { Viewport } from "./slice_renderer.ts";

interface Layer {
  readonly frame: WebGLFramebuffer;
  readonly colour: WebGLTexture;
  readonly depth: WebGLTexture;
  readonly width: number;
  readonly height: number;
  key: string;
}

const kVertex = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}`;

const kFragment = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D u_colours, u_depths;
uniform ivec2 u_corner;
out vec4 colour;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy) - u_corner;
  colour = texelFetch(u_colours, at, 0);
  if (colour.a == 0.0) discard;
  gl_FragDepth = texelFetch(u_depths, at, 0).r;
}`;

export class LayerCache {
  private readonly program: Program;
  private readonly array: WebGLVertexArrayObject;
  private readonly layers = new Map<string, Layer>();

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.program = new Program(gl, kVertex, kFragment);
    this.array = gl.createVertexArray(); // no attributes: a triangle that covers the viewport
  }

  // Draws the layer `name` into the viewport, tested against the depths that are there. `render` is called when the key
  // or the viewport's size differs from those of the layer's last draw; it draws without blending, and its viewport is
  // that of the layer. Translucent: blended, and without effect on later depths.
  draw(name: string, key: string, viewport: Viewport, translucent: boolean, render: () => void): void {
    const { gl, program } = this;
    const layer = this.layerOf(name, viewport);
    if (layer.key !== key) {
      this.renderInto(layer, render);
      layer.key = key;
    }
    gl.viewport(viewport.x, viewport.y, viewport.width, viewport.height);
    program.use();
    gl.activeTexture(gl.TEXTURE4);
    gl.bindTexture(gl.TEXTURE_2D, layer.colour);
    gl.uniform1i(program.at("u_colours"), 4);
    gl.activeTexture(gl.TEXTURE5);
    gl.bindTexture(gl.TEXTURE_2D, layer.depth);
    gl.uniform1i(program.at("u_depths"), 5);
    gl.uniform2i(program.at("u_corner"), viewport.x, viewport.y);
    if (translucent) {
      gl.enable(gl.BLEND);
      gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
    }
    gl.bindVertexArray(this.array);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  // What was kept shows surfaces that are no longer there.
  clear(): void {
    for (const layer of this.layers.values()) this.delete(layer);
    this.layers.clear();
  }

  private renderInto(layer: Layer, render: () => void): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.frame);
    gl.viewport(0, 0, layer.width, layer.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    render();
    gl.clearColor(0, 0, 0, 1);
    gl.enable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  private layerOf(name: string, { width, height }: Viewport): Layer {
    const kept = this.layers.get(name);
    if (kept && kept.width === width && kept.height === height) return kept;
    if (kept) this.delete(kept);
    const { gl } = this;
    const texture = (internal: number) => {
      const out = gl.createTexture();
      gl.activeTexture(gl.TEXTURE4);
      gl.bindTexture(gl.TEXTURE_2D, out);
      gl.texStorage2D(gl.TEXTURE_2D, 1, internal, width, height);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      return out;
    };
    const layer: Layer = {
      frame: gl.createFramebuffer(),
      colour: texture(gl.RGBA8),
      depth: texture(gl.DEPTH_COMPONENT24),
      width,
      height,
      key: "",
    };
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, layer.colour, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, layer.depth, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.layers.set(name, layer);
    return layer;
  }

  private delete(layer: Layer): void {
    this.gl.deleteFramebuffer(layer.frame);
    this.gl.deleteTexture(layer.colour);
    this.gl.deleteTexture(layer.depth);
  }
}

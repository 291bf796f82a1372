// Runs in the browser: draws planes through a volume with the page's renderer, and returns the pixels.
import type { Plane } from "../../../src/geometry/planes.ts";
import type { Volume, Voxels, Window } from "../../../src/image/volume.ts";
import { labelColours, SliceRenderer } from "../../../src/render/slice_renderer.ts";
import { VolumeTexture } from "../../../src/render/volume_texture.ts";

export interface SliceRequest {
  readonly planes: readonly Plane[];
  readonly mm_per_pixel: number;
  readonly pixels: number; // square panels
  readonly window: Window;
}

const kArrays = { int16: Int16Array, uint16: Uint16Array, uint8: Uint8Array, float32: Float32Array } as const;

function volumeOf(type: keyof typeof kArrays, size: Volume["size"], T: readonly number[], base64: string): Volume {
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  return { size, T_image_index: T, voxels: new kArrays[type](bytes.buffer) as Voxels };
}

let renderer: SliceRenderer;
let gl: WebGL2RenderingContext;
let texture: VolumeTexture;
let second: VolumeTexture | null = null;

const api = {
  load(type: keyof typeof kArrays, size: Volume["size"], T: readonly number[], base64: string): void {
    const canvas = document.createElement("canvas");
    gl = canvas.getContext("webgl2", { antialias: false, alpha: false })!;
    renderer = new SliceRenderer(gl);
    texture = new VolumeTexture(gl, volumeOf(type, size, T, base64));
  },
  loadSecond(type: keyof typeof kArrays, size: Volume["size"], T: readonly number[], base64: string): void {
    second = new VolumeTexture(gl, volumeOf(type, size, T, base64));
  },
  // Red, green and blue of all panels, row by row from the lower left corner, as base64.
  draw(request: SliceRequest, what: "image" | "second" | "labels"): string {
    const n = request.pixels;
    gl.canvas.width = gl.canvas.height = n;
    const image = { texture, window: request.window };
    const colours = labelColours(gl, new Map([[3, [1, 0, 0.5]]]));
    const layers = {
      image,
      ...(what === "second"
        ? { second: { texture: second!, window: request.window, blend: 0.5, tint: [1, 1, 1] as const } }
        : {}),
      ...(what === "labels"
        ? { labels: { texture: second!, colours: colours.texture, count: colours.count, opacity: 0.5 } }
        : {}),
    };
    const out = new Uint8Array(3 * n * n * request.planes.length);
    const rgba = new Uint8Array(4 * n * n);
    request.planes.forEach((plane, p) => {
      renderer.draw(layers, plane, request.mm_per_pixel, { x: 0, y: 0, width: n, height: n });
      gl.readPixels(0, 0, n, n, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
      for (let i = 0; i < n * n; ++i) out.set(rgba.subarray(4 * i, 4 * i + 3), 3 * (p * n * n + i));
    });
    let text = "";
    for (let i = 0; i < out.length; i += 8192) text += String.fromCharCode(...out.subarray(i, i + 8192));
    return btoa(text);
  },
};
export type SlicesApi = typeof api;
(globalThis as unknown as { slices: SlicesApi }).slices = api;

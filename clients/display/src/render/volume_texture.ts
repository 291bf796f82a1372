// A volume on the graphics card, with the exact values of its voxels: integers stay integers.
import { indexFromImage, type Volume } from "../image/volume.ts";

export type SamplerType = "usampler3D" | "isampler3D" | "sampler3D";

export class VolumeTexture {
  readonly sampler: SamplerType;
  readonly T_index_image: readonly number[]; // 12 numbers, see image/volume.ts
  readonly texture: WebGLTexture;

  // Throws an Error with a sentence if the volume does not fit.
  constructor(
    private readonly gl: WebGL2RenderingContext,
    readonly volume: Volume,
  ) {
    const [ni, nj, nk] = volume.size;
    const largest = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number;
    if (!gl.isContextLost() && Math.max(ni, nj, nk) > largest) {
      throw new Error(`image of ${ni} x ${nj} x ${nk} voxels: this computer can draw ${largest} along an axis`);
    }
    const [sampler, internal, format, type] = formatOf(gl, volume);
    this.sampler = sampler;
    this.T_index_image = indexFromImage(volume);
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_3D, this.texture);
    for (const parameter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_3D, parameter, gl.NEAREST); // the shader interpolates
    }
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texStorage3D(gl.TEXTURE_3D, 1, internal, ni, nj, nk);
    // Slice by slice: some drivers copy what they are given at once.
    for (let k = 0; k < nk; ++k) {
      const slice = volume.voxels.subarray(k * ni * nj, (k + 1) * ni * nj);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, k, ni, nj, 1, format, type, slice);
    }
  }

  bind(unit: number): void {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_3D, this.texture);
  }

  delete(): void {
    this.gl.deleteTexture(this.texture);
  }
}

function formatOf(gl: WebGL2RenderingContext, volume: Volume): [SamplerType, number, number, number] {
  const voxels = volume.voxels;
  if (voxels instanceof Uint8Array) return ["usampler3D", gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE];
  if (voxels instanceof Int8Array) return ["isampler3D", gl.R8I, gl.RED_INTEGER, gl.BYTE];
  if (voxels instanceof Uint16Array) return ["usampler3D", gl.R16UI, gl.RED_INTEGER, gl.UNSIGNED_SHORT];
  if (voxels instanceof Int16Array) return ["isampler3D", gl.R16I, gl.RED_INTEGER, gl.SHORT];
  return ["sampler3D", gl.R32F, gl.RED, gl.FLOAT];
}

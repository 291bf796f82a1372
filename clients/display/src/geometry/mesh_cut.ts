// Cut of a triangle mesh by a plane: line segments in the picture.
import { type Plane, viewer } from "./planes.ts";
import { dot } from "./vector.ts";

export interface Mesh {
  readonly vertices_mm: Float32Array; // x y z per vertex, Image
  readonly triangles: Uint32Array; // three vertices per triangle
}

// u v u v per segment, in mm of the picture. The array is reused: it is valid until the next cut of the same cutter.
export interface Segments {
  readonly uv_mm: Float32Array;
  readonly count: number;
}

// Cuts one mesh again and again. Heights of all vertices first, then the triangles whose corners lie on both sides.
export class MeshCutter {
  private readonly heights: Float32Array;
  private uv = new Float32Array(4096);

  constructor(readonly mesh: Mesh) {
    this.heights = new Float32Array(mesh.vertices_mm.length / 3);
  }

  cut(plane: Plane): Segments {
    this.measure(plane);
    const { triangles } = this.mesh;
    const h = this.heights;
    let count = 0;
    for (let t = 0; t < triangles.length; t += 3) {
      const a = triangles[t];
      const b = triangles[t + 1];
      const c = triangles[t + 2];
      const sa = h[a] >= 0;
      const sb = h[b] >= 0;
      const sc = h[c] >= 0;
      if (sa === sb && sb === sc) continue;
      if (4 * (count + 1) > this.uv.length) this.grow();
      // The corner that is alone on its side has both cut edges.
      if (sb === sc) this.segment(count++, plane, a, b, c);
      else if (sa === sc) this.segment(count++, plane, b, c, a);
      else this.segment(count++, plane, c, a, b);
    }
    return { uv_mm: this.uv, count };
  }

  private measure(plane: Plane): void {
    const v = this.mesh.vertices_mm;
    const h = this.heights;
    const n = viewer(plane);
    const [nx, ny, nz] = n;
    const offset = dot(n, plane.centre);
    for (let i = 0, k = 0; i < h.length; ++i, k += 3) h[i] = nx * v[k] + ny * v[k + 1] + nz * v[k + 2] - offset;
  }

  private segment(index: number, plane: Plane, alone: number, other1: number, other2: number): void {
    this.crossing(4 * index, plane, alone, other1);
    this.crossing(4 * index + 2, plane, alone, other2);
  }

  private crossing(at: number, plane: Plane, i: number, j: number): void {
    const v = this.mesh.vertices_mm;
    const s = this.heights[i] / (this.heights[i] - this.heights[j]);
    const x = v[3 * i] + s * (v[3 * j] - v[3 * i]) - plane.centre[0];
    const y = v[3 * i + 1] + s * (v[3 * j + 1] - v[3 * i + 1]) - plane.centre[1];
    const z = v[3 * i + 2] + s * (v[3 * j + 2] - v[3 * i + 2]) - plane.centre[2];
    this.uv[at] = x * plane.right[0] + y * plane.right[1] + z * plane.right[2];
    this.uv[at + 1] = x * plane.up[0] + y * plane.up[1] + z * plane.up[2];
  }

  private grow(): void {
    const larger = new Float32Array(2 * this.uv.length);
    larger.set(this.uv);
    this.uv = larger;
  }
}

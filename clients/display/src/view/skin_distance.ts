// Distance of points from a surface: the triangles near a point are found in a grid of cells.
import type { Mesh } from "../geometry/mesh_cut.ts";
import { add, cross, distance, dot, scale, sub, type Vec3 } from "../geometry/vector.ts";

const kCell_mm = 8;
const kMaxRings = 6; // farther points are stated as farther than this

export class SkinDistance {
  private readonly cells = new Map<string, number[]>();

  constructor(private readonly mesh: Mesh) {
    const { triangles } = mesh;
    for (let t = 0; t < triangles.length; t += 3) {
      const corners = [this.vertex(triangles[t]), this.vertex(triangles[t + 1]), this.vertex(triangles[t + 2])];
      const low = cellOf([0, 1, 2].map((d) => Math.min(...corners.map((c) => c[d]))) as unknown as Vec3);
      const high = cellOf([0, 1, 2].map((d) => Math.max(...corners.map((c) => c[d]))) as unknown as Vec3);
      for (let x = low[0]; x <= high[0]; ++x) {
        for (let y = low[1]; y <= high[1]; ++y) for (let z = low[2]; z <= high[2]; ++z) this.put(`${x} ${y} ${z}`, t);
      }
    }
  }

  // Infinity beyond 40 mm.
  of(point: Vec3): number {
    const [cx, cy, cz] = cellOf(point);
    let best = Number.POSITIVE_INFINITY;
    for (let ring = 0; ring <= kMaxRings; ++ring) {
      // Cells of this ring are at least (ring - 1) cells away.
      if (best <= (ring - 1) * kCell_mm) break;
      for (let x = -ring; x <= ring; ++x) {
        for (let y = -ring; y <= ring; ++y) {
          for (let z = -ring; z <= ring; ++z) {
            if (Math.max(Math.abs(x), Math.abs(y), Math.abs(z)) !== ring) continue;
            for (const t of this.cells.get(`${cx + x} ${cy + y} ${cz + z}`) ?? [])
              best = Math.min(best, this.toTriangle(point, t));
          }
        }
      }
    }
    return best;
  }

  private put(key: string, triangle: number): void {
    const cell = this.cells.get(key);
    if (cell) cell.push(triangle);
    else this.cells.set(key, [triangle]);
  }

  private vertex(i: number): Vec3 {
    const v = this.mesh.vertices_mm;
    return [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
  }

  private toTriangle(p: Vec3, t: number): number {
    const { triangles } = this.mesh;
    const [a, b, c] = [this.vertex(triangles[t]), this.vertex(triangles[t + 1]), this.vertex(triangles[t + 2])];
    const n = cross(sub(b, a), sub(c, a));
    const area2 = dot(n, n);
    if (area2 > 0) {
      // Barycentric coordinates of the foot on the triangle's plane.
      const wa = dot(cross(sub(c, b), sub(p, b)), n) / area2;
      const wb = dot(cross(sub(a, c), sub(p, c)), n) / area2;
      if (wa >= 0 && wb >= 0 && wa + wb <= 1) return Math.abs(dot(sub(p, a), n)) / Math.sqrt(area2);
    }
    return Math.min(toEdge(p, a, b), toEdge(p, b, c), toEdge(p, c, a));
  }
}

const cellOf = (p: Vec3): Vec3 => [
  Math.floor(p[0] / kCell_mm),
  Math.floor(p[1] / kCell_mm),
  Math.floor(p[2] / kCell_mm),
];

function toEdge(p: Vec3, a: Vec3, b: Vec3): number {
  const e = sub(b, a);
  const length2 = dot(e, e);
  const s = length2 > 0 ? Math.min(Math.max(dot(sub(p, a), e) / length2, 0), 1) : 0;
  return distance(p, add(a, scale(e, s)));
}

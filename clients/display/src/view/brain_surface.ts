// The brain's surface as the tissue model has it, coloured by displacement or stress.
import type { Mesh } from "../geometry/mesh_cut.ts";
import type { FieldArrays } from "../state/frame.ts";

export interface DeformedSurface {
  readonly mesh: Mesh;
  readonly colours: Float32Array;
  readonly largest: number; // value of the last colour
}

// Null if the field is not of this mesh, or has no values for the colour.
export function deformedSurface(mesh: Mesh, field: FieldArrays, by: "displacement" | "stress"): DeformedSurface | null {
  const nodes = mesh.vertices_mm.length / 3;
  if (field.displacement_mm.length !== 3 * nodes) return null;
  const values = by === "stress" ? field.von_mises_Pa : lengths(field.displacement_mm);
  if (values.length !== nodes) return null;
  const vertices_mm = new Float32Array(3 * nodes);
  for (let i = 0; i < 3 * nodes; ++i) vertices_mm[i] = mesh.vertices_mm[i] + field.displacement_mm[i];
  let largest = by === "stress" ? 100 : 0.5;
  for (const t of mesh.triangles) if (values[t] > largest) largest = values[t];
  const colours = new Float32Array(3 * nodes);
  for (let i = 0; i < nodes; ++i) colours.set(heat(values[i] / largest), 3 * i);
  return { mesh: { vertices_mm, triangles: mesh.triangles }, colours, largest };
}

function lengths(xyz: Float32Array): Float32Array {
  const out = new Float32Array(xyz.length / 3);
  for (let i = 0; i < out.length; ++i) out[i] = Math.hypot(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
  return out;
}

// From grey-blue over yellow to red, brighter all the way until red.
function heat(t: number): [number, number, number] {
  const stops = [
    [0.35, 0.45, 0.55],
    [0.3, 0.75, 0.75],
    [1, 0.88, 0.4],
    [1, 0.35, 0.3],
  ];
  const s = Math.min(Math.max(Number.isFinite(t) ? t : 0, 0), 1) * (stops.length - 1);
  const i = Math.min(Math.floor(s), stops.length - 2);
  return [0, 1, 2].map((d) => stops[i][d] + (s - i) * (stops[i + 1][d] - stops[i][d])) as [number, number, number];
}

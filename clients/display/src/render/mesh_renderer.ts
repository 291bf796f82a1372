// Draws triangle meshes in space: surfaces, and the unit sphere and cylinder as regions, tools and lines.
import type { Mesh } from "../geometry/mesh_cut.ts";
import { cross, norm, perpendicular, scale, sub, unit, type Vec3 } from "../geometry/vector.ts";
import { Program } from "./program.ts";

export type Colour = readonly [red: number, green: number, blue: number]; // 0 to 1

const kVertex = `#version 300 es
layout(location = 0) in vec3 a_position;
layout(location = 1) in vec3 a_normal;
layout(location = 2) in vec3 a_colour;
uniform mat4 u_model, u_view;
uniform mat3 u_normal;
out vec3 v_normal;
out vec3 v_colour;
void main() {
  v_normal = u_normal * a_normal;
  v_colour = a_colour;
  gl_Position = u_view * (u_model * vec4(a_position, 1.0));
}`;

// Light from the viewer, from both sides of a surface.
const kFragment = `#version 300 es
precision highp float;
in vec3 v_normal;
in vec3 v_colour;
uniform vec3 u_colour, u_viewer;
uniform float u_opacity, u_own_colour;
out vec4 colour;
void main() {
  float facing = abs(dot(normalize(v_normal), u_viewer));
  vec3 base = mix(u_colour, v_colour, u_own_colour);
  float edge = mix(1.0, 1.6 - facing, step(u_opacity, 0.99)); // a translucent surface is denser at its rim
  colour = vec4(base * (0.25 + 0.75 * facing), clamp(u_opacity * edge, 0.0, 1.0));
}`;

export interface MeshBuffer {
  readonly array: WebGLVertexArrayObject;
  readonly buffers: readonly WebGLBuffer[];
  readonly count: number;
}

export interface MeshStyle {
  readonly colour: Colour;
  readonly opacity: number;
  readonly ownColours?: boolean; // those of the vertices
}

export class MeshRenderer {
  private readonly program: Program;
  private readonly sphere: MeshBuffer;
  private readonly cylinder: MeshBuffer;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.program = new Program(gl, kVertex, kFragment);
    this.sphere = this.upload(unitSphere(24));
    this.cylinder = this.upload(unitCylinder(16));
  }

  // With colours, three numbers of 0 to 1 per vertex.
  upload(mesh: Mesh, colours?: Float32Array): MeshBuffer {
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const attributes = [mesh.vertices_mm, vertexNormals(mesh), ...(colours ? [colours] : [])];
    const buffers = attributes.map((values, location) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
      return buffer;
    });
    const elements = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, elements);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.triangles, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { array, buffers: [...buffers, elements], count: mesh.triangles.length };
  }

  delete(mesh: MeshBuffer): void {
    for (const buffer of mesh.buffers) this.gl.deleteBuffer(buffer);
    this.gl.deleteVertexArray(mesh.array);
  }

  begin(view: Float32Array, viewer: Vec3): void {
    this.program.use();
    this.gl.uniformMatrix4fv(this.program.at("u_view"), false, view);
    this.gl.uniform3fv(this.program.at("u_viewer"), viewer);
  }

  draw(mesh: MeshBuffer, style: MeshStyle): void {
    this.drawModel(mesh, style, kIdentity4, kIdentity3);
  }

  // The ellipsoid with these semi-axes as vectors.
  drawEllipsoid(centre: Vec3, semiAxes: readonly [Vec3, Vec3, Vec3], style: MeshStyle): void {
    const [a, b, c] = semiAxes;
    const model = new Float32Array([...a, 0, ...b, 0, ...c, 0, ...centre, 1]);
    const over = (v: Vec3) => scale(v, 1 / Math.max(norm(v) ** 2, 1e-12));
    const normal = new Float32Array([...over(a), ...over(b), ...over(c)]);
    if (style.opacity >= 1) {
      this.drawModel(this.sphere, style, model, normal);
      return;
    }
    this.blended(() => this.drawModel(this.sphere, style, model, normal));
  }

  drawBall(centre: Vec3, radius_mm: number, style: MeshStyle): void {
    this.drawEllipsoid(
      centre,
      [
        [radius_mm, 0, 0],
        [0, radius_mm, 0],
        [0, 0, radius_mm],
      ],
      style,
    );
  }

  drawRod(from: Vec3, to: Vec3, radius_mm: number, style: MeshStyle): void {
    const along = sub(to, from);
    const direction = unit(along);
    const a = perpendicular(direction, Math.abs(direction[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]);
    const b = cross(direction, a);
    const model = new Float32Array([...scale(a, radius_mm), 0, ...scale(b, radius_mm), 0, ...along, 0, ...from, 1]);
    this.drawModel(this.cylinder, style, model, new Float32Array([...a, ...b, ...direction]));
  }

  private blended(draw: () => void): void {
    const { gl } = this;
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    draw();
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  private drawModel(mesh: MeshBuffer, style: MeshStyle, model: Float32Array, normal: Float32Array): void {
    const { gl, program } = this;
    gl.uniformMatrix4fv(program.at("u_model"), false, model);
    gl.uniformMatrix3fv(program.at("u_normal"), false, normal);
    gl.uniform3fv(program.at("u_colour"), style.colour);
    gl.uniform1f(program.at("u_opacity"), style.opacity);
    gl.uniform1f(program.at("u_own_colour"), style.ownColours ? 1 : 0);
    gl.bindVertexArray(mesh.array);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
  }
}

const kIdentity4 = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
const kIdentity3 = new Float32Array([1, 0, 0, 0, 1, 0, 0, 0, 1]);

// Mean of the normals of a vertex's triangles, weighted by their areas.
export function vertexNormals({ vertices_mm: v, triangles }: Mesh): Float32Array {
  const normals = new Float32Array(v.length);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const [ux, uy, uz] = [v[b] - v[a], v[b + 1] - v[a + 1], v[b + 2] - v[a + 2]];
    const [wx, wy, wz] = [v[c] - v[a], v[c + 1] - v[a + 1], v[c + 2] - v[a + 2]];
    const n = [uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx];
    for (const corner of [a, b, c]) for (let d = 0; d < 3; ++d) normals[corner + d] += n[d];
  }
  for (let i = 0; i < normals.length; i += 3) {
    const length = Math.hypot(normals[i], normals[i + 1], normals[i + 2]) || 1;
    for (let d = 0; d < 3; ++d) normals[i + d] /= length;
  }
  return normals;
}

function unitSphere(rings: number): Mesh {
  return revolved(rings, 2 * rings, (s) => [Math.sin(Math.PI * s), Math.cos(Math.PI * s)]);
}

// Radius 1, from z = 0 to z = 1, with flat ends.
function unitCylinder(sides: number): Mesh {
  const profile: readonly (readonly [number, number])[] = [
    [0, 1],
    [1, 1],
    [1, 0],
    [0, 0],
  ];
  return revolved(3, sides, (s) => profile[Math.round(3 * s)]);
}

// Turns a profile (radius, height) about z.
function revolved(steps: number, sides: number, profile: (s: number) => readonly [number, number]): Mesh {
  const vertices: number[] = [];
  const triangles: number[] = [];
  for (let i = 0; i <= steps; ++i) {
    const [radius, height] = profile(i / steps);
    for (let j = 0; j < sides; ++j) {
      const phi = (2 * Math.PI * j) / sides;
      vertices.push(radius * Math.cos(phi), radius * Math.sin(phi), height);
      if (i === steps) continue;
      const next = (j + 1) % sides;
      const [a, b, c, d] = [i * sides + j, i * sides + next, (i + 1) * sides + j, (i + 1) * sides + next];
      triangles.push(a, c, b, b, c, d);
    }
  }
  return { vertices_mm: new Float32Array(vertices), triangles: new Uint32Array(triangles) };
}

// Letters at the edges of a picture: R L A P S I of the patient. Image is RAS.
import type { Plane } from "./planes.ts";
import { negate, type Vec3 } from "./vector.ts";

const kPositive = ["R", "A", "S"];
const kNegative = ["L", "P", "I"];

// A further letter is stated from this part of the direction on: sin 22.5 degrees.
const kSecondLetter = Math.sin(Math.PI / 8);

// Letters of a unit direction, the strongest first: "R", or "RA" for one between.
export function lettersOf(direction: Vec3): string {
  return [0, 1, 2]
    .sort((i, j) => Math.abs(direction[j]) - Math.abs(direction[i]))
    .filter((i, rank) => rank === 0 || Math.abs(direction[i]) >= kSecondLetter)
    .map((i) => (direction[i] > 0 ? kPositive[i] : kNegative[i]))
    .join("");
}

export interface EdgeLetters {
  readonly left: string;
  readonly right: string;
  readonly top: string;
  readonly bottom: string;
}

export function edgeLetters(plane: Plane): EdgeLetters {
  return {
    left: lettersOf(negate(plane.right)),
    right: lettersOf(plane.right),
    top: lettersOf(plane.up),
    bottom: lettersOf(negate(plane.up)),
  };
}

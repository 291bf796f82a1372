// against_truth.mjs STATUS.json TOOL "tip R A S": the tip that the daemon shows beside where it truly is, and the bound.
// Exit code 1: the tip is not live, or farther off than 3 mm and its 95 % bound.
import { readFileSync } from "node:fs";

const [file, name, truth] = process.argv.slice(2);
const tool = JSON.parse(readFileSync(file, "utf8")).tools.find((tool) => tool.tool === name);
const tip = tool?.tip_mm;
if (!tip || tip.some((value) => value === null)) {
  console.error(`${name} is not live`);
  process.exit(1);
}
const actual = truth.split(" ").slice(1).map(Number);
const error_mm = Math.hypot(...tip.map((value, axis) => value - actual[axis]));
const bound_mm = tool.tre_95_mm;
console.log(`${name} is shown ${error_mm.toFixed(2)} mm off, 95 % bound ${bound_mm.toFixed(2)} mm`);
process.exit(error_mm > Math.max(3, bound_mm) ? 1 : 0);

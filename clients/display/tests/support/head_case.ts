// The case of the demo, made once per build folder from the head that mricron-data installs.
import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, renameSync, rmSync } from "node:fs";

const kHead = "/usr/share/mricron/templates";

export function headCase(build: string, source: string): string {
  const folder = `${build}/display_cases/colin27`; // a case is named after its folder
  if (existsSync(`${folder}/labels.txt`)) return folder;
  const plan = `${source}/demo/colin27`;
  const unfinished = `${build}/display_cases/unfinished/colin27`;
  rmSync(unfinished, { recursive: true, force: true });
  mkdirSync(`${build}/display_cases/unfinished`, { recursive: true });
  const files: [string, string][] = [
    ["--image", `${kHead}/ch2.nii.gz`],
    ["--brain", `${kHead}/ch2bet.nii.gz`],
    ["--labels", `${kHead}/aal.nii.gz`],
    ["--fiducials", `${plan}/fiducials.mrk.json`],
    ["--landmarks", `${plan}/landmarks.mrk.json`],
    ["--brain-landmarks", `${plan}/brain_landmarks.mrk.json`],
    ["--targets", `${plan}/targets.mrk.json`],
    ["--trajectories", `${plan}/trajectories.mrk.json`],
    ["--tools", `${plan}/tools.toml`],
  ];
  execFileSync(`${build}/bin/bregma`, ["case", "create", unfinished, ...files.flat()], { stdio: "ignore" });
  rmSync(folder, { recursive: true, force: true }); // one of an earlier version
  renameSync(unfinished, folder);
  return folder;
}

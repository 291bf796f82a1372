// Sentences for the constants of the wire. An unknown value is said to be unknown.
import { CoilOutcome, DeviceStatus, PoseStatus, ScannerActivity, Session, ToolStatus } from "./constants.ts";

const look = (table: Readonly<Record<number, string>>, value: number): string => table[value] ?? `unknown (${value})`;

const session: Record<number, string> = {
  0: "Not stated",
  [Session.IDLE]: "Idle",
  [Session.CASE_LOADED]: "Case loaded",
  [Session.REGISTERING]: "Registering",
  [Session.REGISTERED]: "Registered, not verified",
  [Session.VERIFIED]: "Verified",
  [Session.NAVIGATING]: "Navigating",
  [Session.DEGRADED]: "Degraded",
  [Session.FAULT]: "Fault",
};
export const sessionText = (value: number): string => look(session, value);

const pose: Record<number, string> = {
  [PoseStatus.LIVE]: "live",
  [PoseStatus.UNVERIFIED]: "not verified",
  [PoseStatus.STALE]: "pose too old",
  [PoseStatus.LOST]: "tracker silent",
  [PoseStatus.TOOL_HIDDEN]: "not seen by the camera",
  [PoseStatus.REFERENCE_HIDDEN]: "reference not seen",
  [PoseStatus.NOT_CALIBRATED]: "tip not calibrated",
  [PoseStatus.NOT_REGISTERED]: "patient not registered",
  [PoseStatus.IMPLAUSIBLE]: "tracker's data refused",
};
export const poseText = (value: number): string => look(pose, value);

const implausible: Record<number, string> = {
  1: "",
  2: "frozen",
  3: "turned as no hand can",
  4: "outside the camera's volume",
  5: "jumped",
  6: "badly fitted markers",
  7: "too few markers",
  8: "reference displaced",
};
export const implausibleText = (value: number): string => look(implausible, value);

const tool: Record<number, string> = {
  0: "not seen",
  [ToolStatus.VISIBLE]: "visible",
  [ToolStatus.PARTLY_VISIBLE]: "partly visible",
  [ToolStatus.HIDDEN]: "hidden",
  [ToolStatus.OUT_OF_VOLUME]: "outside the volume",
};
export const toolText = (value: number): string => look(tool, value);

const registration: Record<number, string> = {
  1: "No samples yet",
  2: "Refused",
  3: "Candidate, not accepted",
  4: "Accepted",
};
export const registrationText = (value: number): string => look(registration, value);

const device: Record<number, string> = {
  [DeviceStatus.NEVER_SEEN]: "never seen",
  [DeviceStatus.LIVE]: "live",
  [DeviceStatus.STALE]: "stale",
  [DeviceStatus.LOST]: "lost",
};
export const deviceText = (value: number): string => look(device, value);

const scannerStep: Record<number, string> = {
  1: "Not started",
  2: "Scout of the phantom",
  3: "Phantom",
  4: "Swap of phantom and frame",
  5: "Scout of the frame",
  6: "Coils at the top",
  7: "Coils at the bottom",
  8: "Verification",
  9: "Acceptance",
  10: "Registered",
};
export const scannerStepText = (value: number): string => look(scannerStep, value);

const scannerActivity: Record<number, string> = {
  0: "not current",
  [ScannerActivity.NONE]: "",
  [ScannerActivity.WAITS]: "waits for the operator",
  [ScannerActivity.SWITCHES_COILS]: "switches the coils",
  [ScannerActivity.ACQUIRES]: "acquires",
  [ScannerActivity.COMPUTES]: "computes",
  [ScannerActivity.FAILED]: "failed",
};
export const scannerActivityText = (value: number): string => look(scannerActivity, value);

const scannerVerdict: Record<number, string> = {
  1: "no estimate",
  2: "found",
  3: "inaccurate",
  4: "inconsistent",
  5: "ambiguous",
  6: "refused",
};
export const scannerVerdictText = (value: number): string => look(scannerVerdict, value);

const scannerValidity: Record<number, string> = {
  0: "not current",
  1: "none is accepted",
  2: "valid",
  3: "void: the table moved",
  4: "void: coils are not where it expects them",
  5: "void: its distortion field has expired",
};
export const scannerValidityText = (value: number): string => look(scannerValidity, value);

const distortionField: Record<number, string> = { 1: "none", 2: "valid", 3: "expired" };
export const distortionFieldText = (value: number): string => look(distortionField, value);

const coil: Record<number, string> = {
  [CoilOutcome.NOT_SEEN]: "not seen",
  [CoilOutcome.USED]: "used",
  [CoilOutcome.OUTLIER]: "left out",
  [CoilOutcome.VERIFIES]: "verifies",
  [CoilOutcome.IDLE]: "no current yet",
};
export const coilText = (value: number): string => look(coil, value);

const driver: Record<number, string> = {
  0: "",
  1: "connecting",
  2: "connected",
  3: "waiting to connect",
  4: "stopped",
};
export const driverText = (value: number): string => look(driver, value);

const deformation: Record<number, string> = {
  0: "Not current",
  1: "No model",
  2: "Valid",
  3: "Extrapolating",
  4: "Invalid",
};
export const deformationText = (value: number): string => look(deformation, value);

const deformationReason: Record<number, string> = {
  0: "",
  1: "",
  2: "residual vibration",
  3: "probe not seen",
  4: "probe jumped",
  5: "path of the probe unknown",
  6: "computed too slowly",
  7: "probe left the mesh",
  8: "inverted elements",
  9: "step rejected",
  10: "diverged, reset to rest",
  11: "model is being built",
  12: "brain cannot be meshed",
  13: "point outside the mesh",
};
export const deformationReasonText = (value: number): string => look(deformationReason, value);

const phase: Record<number, string> = { 0: "–", 1: "outside", 2: "indentation", 3: "penetration", 4: "withdrawal" };
export const phaseText = (value: number): string => look(phase, value);

// A number for the operator; "–" for one that is not known.
export function figure(value: number, decimals: number, unit = ""): string {
  if (!Number.isFinite(value)) return "–";
  const text = value
    .toFixed(decimals)
    .replace(/^-(0(\.0*)?)$/, "$1")
    .replace("-", "−");
  return unit ? `${text} ${unit}` : text;
}

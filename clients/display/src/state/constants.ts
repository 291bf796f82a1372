// Constants of idl/state.idl and idl/streams.idl that the page uses. A value that is not named here is unknown, and unknown
// is never good (docs/wire.md).
export const PoseStatus = {
  LIVE: 1,
  UNVERIFIED: 2,
  STALE: 3,
  LOST: 4,
  TOOL_HIDDEN: 5,
  REFERENCE_HIDDEN: 6,
  NOT_CALIBRATED: 7,
  NOT_REGISTERED: 8,
  IMPLAUSIBLE: 9,
} as const;

export const Plausibility = { UNKNOWN: 0, GOOD: 1, INFLATED: 2, REFUSED: 3 } as const;
export const Session = {
  IDLE: 1,
  CASE_LOADED: 2,
  REGISTERING: 3,
  REGISTERED: 4,
  VERIFIED: 5,
  NAVIGATING: 6,
  DEGRADED: 7,
  FAULT: 8,
} as const;
export const Presence = { NEVER_HEARD: 0, SILENT: 1, ALIVE: 2 } as const;
export const CaseState = { NONE: 0, NO_SERVER: 1, ON_ITS_WAY: 2, COMPLETE: 3, FAILED: 4 } as const;
export const RegistrationStatus = { NONE: 1, REFUSED: 2, CANDIDATE: 3, ACCEPTED: 4 } as const;
export const CaptureKind = { FIDUCIAL_TOUCH: 1, SURFACE: 2, CHECK: 3 } as const;
export const AlarmState = { RAISED: 1, ACKNOWLEDGED: 2, CLEARED: 3 } as const;
export const Severity = { INFO: 1, WARNING: 2, CRITICAL: 3 } as const;
export const ToolStatus = { VISIBLE: 1, PARTLY_VISIBLE: 2, HIDDEN: 3, OUT_OF_VOLUME: 4 } as const;
export const DeformationStatus = { NO_MODEL: 1, VALID: 2, EXTRAPOLATING: 3, INVALID: 4 } as const;
export const ScannerStep = { IDLE: 1, ACCEPT: 9, DONE: 10 } as const;
export const ScannerActivity = { NONE: 1, WAITS: 2, SWITCHES_COILS: 3, ACQUIRES: 4, COMPUTES: 5, FAILED: 6 } as const;
export const ScannerVerdict = { NONE: 1, FOUND: 2 } as const;
export const ScannerValidity = { NONE: 1, VALID: 2 } as const;
export const FieldStatus = { NONE: 1, VALID: 2, EXPIRED: 3 } as const;
export const CoilOutcome = { NOT_SEEN: 1, USED: 2, OUTLIER: 3, VERIFIES: 4, IDLE: 5 } as const;
export const DeviceKind = { TRACKER: 1, ROBOT: 2 } as const;
export const DeviceStatus = { NEVER_SEEN: 1, LIVE: 2, STALE: 3, LOST: 4 } as const;
export const kRobotBase = "RobotBase"; // reference of a case with an arm and without a tracker

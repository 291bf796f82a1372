// Colours of what is drawn. Each thing has one colour in all panels.
export const kColours = {
  live: "#45e0a0",
  unverified: "#ffab2e",
  plan: "#ffe066",
  target: "#ffe066",
  predicted: "#ff7ad9",
  brain: "#8fb8d8",
  scalp: "#c9a58a",
  fiducial: "#7fd4ff",
  suspect: "#ff5c5c",
  measure: "#f2f2f2",
  letter: "#dfe7ee",
  muted: "#8b98a6",
  unknown: "#9fb3c8", // a point whose distance from the skin is not known
  axial: "#ff7a6b",
  coronal: "#63d98b",
  sagittal: "#62b3ff",
} as const;

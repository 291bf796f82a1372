// Layout of the records of /state, as docs/gateway.md states it: the unit tests compare this table with that page.

// Type of a field on the wire: a number, a fixed array of numbers, or a text padded with NUL.
export type FieldType = "f64" | "i32" | "u32" | `f64[${number}]` | `char[${number}]`;

export interface RecordLayout {
  readonly kind: number;
  readonly keys: readonly string[]; // fields that tell the instances apart; none: there is one
  readonly fields: Readonly<Record<string, readonly [offset: number, type: FieldType]>>;
}

const layouts = {
  pong: {
    kind: 1,
    keys: [],
    fields: {
      client_ms: [8, "f64"],
      received_ms: [16, "f64"],
      written_ms: [24, "f64"],
    },
  },
  link: {
    kind: 2,
    keys: [],
    fields: {
      silent_ms: [8, "f64"],
      last_state_ms: [16, "f64"],
      presence: [24, "u32"],
      changes: [28, "u32"],
      wire_generation: [32, "u32"],
      wire_revision: [36, "u32"],
      host: [40, "char[32]"],
      text: [72, "char[256]"],
    },
  },
  case: {
    kind: 3,
    keys: [],
    fields: {
      fraction: [8, "f64"],
      state: [16, "u32"],
      hash: [24, "char[64]"],
      id: [88, "char[32]"],
      text: [120, "char[256]"],
    },
  },
  session: {
    kind: 4,
    keys: [],
    fields: {
      session: [8, "i32"],
      time_ms: [16, "f64"],
      next: [24, "char[256]"],
    },
  },
  tool: {
    kind: 5,
    keys: ["tool"],
    fields: {
      tool: [8, "char[32]"],
      frame: [40, "f64"],
      acquired_ms: [48, "f64"],
      published_ms: [56, "f64"],
      valid_until_ms: [64, "f64"],
      age_sigma_ms: [72, "f64"],
      status: [80, "i32"],
      session: [84, "i32"],
      rotation: [88, "f64[9]"],
      tip_mm: [160, "f64[3]"],
      velocity_mm_s: [184, "f64[3]"],
      covariance: [208, "f64[36]"],
      position_velocity_covariance_mm2_s: [496, "f64[9]"],
      velocity_covariance_mm2_s2: [568, "f64[9]"],
      acceleration_sigma_mm_s2: [640, "f64"],
      tre_rms_mm: [648, "f64"],
      tre_95_semi_axes_mm: [656, "f64[3]"],
      tre_95_axes: [680, "f64[9]"],
      trajectory: [752, "char[32]"],
      distance_to_target_mm: [784, "f64"],
      lateral_deviation_mm: [792, "f64"],
      angle_rad: [800, "f64"],
      remaining_depth_mm: [808, "f64"],
      predicted_target_mm: [816, "f64[3]"],
      distance_to_predicted_target_mm: [840, "f64"],
      nearest_structure: [848, "char[32]"],
      nearest_structure_mm: [880, "f64"],
      prediction: [888, "i32"],
      plausibility: [892, "i32"],
      plausibility_reason: [896, "i32"],
      source_kind: [900, "i32"],
      source: [904, "char[32]"],
    },
  },
  registration: {
    kind: 6,
    keys: ["reference"],
    fields: {
      reference: [8, "char[32]"],
      time_ms: [40, "f64"],
      revision: [48, "f64"],
      accepted_revision: [56, "f64"],
      status: [64, "i32"],
      reason: [68, "i32"],
      subject: [72, "char[32]"],
      text: [104, "char[256]"],
      rotation: [360, "f64[9]"],
      translation_mm: [432, "f64[3]"],
      accepted_rotation: [456, "f64[9]"],
      accepted_translation_mm: [528, "f64[3]"],
      fiducials: [552, "u32"],
      surface_samples: [556, "u32"],
      fre_mm: [560, "f64"],
      fre_expected_mm: [568, "f64"],
      surface_rms_mm: [576, "f64"],
    },
  },
  fiducial: {
    kind: 7,
    keys: ["fiducial"],
    fields: {
      fiducial: [8, "char[32]"],
      residual_mm: [40, "f64[3]"],
      norm_mm: [64, "f64"],
      leave_one_out_mm: [72, "f64"],
      p_value: [80, "f64"],
      suspect: [88, "u32"],
    },
  },
  accuracy: {
    kind: 8,
    keys: ["reference"],
    fields: {
      reference: [8, "char[32]"],
      time_ms: [40, "f64"],
      fre_mm: [48, "f64"],
      fre_expected_mm: [56, "f64"],
      last_check_mm: [64, "f64"],
      last_check_limit_mm: [72, "f64"],
      drift_statistic: [80, "f64"],
      drift_threshold: [88, "f64"],
      checks: [96, "u32"],
      drift_detected: [100, "u32"],
    },
  },
  target: {
    kind: 9,
    keys: ["target"],
    fields: {
      target: [8, "char[32]"],
      tre_rms_mm: [40, "f64"],
      covariance_mm2: [48, "f64[9]"],
      tre_95_semi_axes_mm: [120, "f64[3]"],
      tre_95_axes: [144, "f64[9]"],
    },
  },
  deformation: {
    kind: 10,
    keys: ["point"],
    fields: {
      point: [8, "char[32]"],
      time_ms: [40, "f64"],
      kind: [48, "i32"],
      status: [52, "i32"],
      reason: [56, "i32"],
      phase: [60, "i32"],
      imaged_mm: [64, "f64[3]"],
      displaced_mm: [88, "f64[3]"],
      error_bound_mm: [112, "f64"],
      von_mises_Pa: [120, "f64"],
      tip_force_N: [128, "f64"],
      shaft_force_N: [136, "f64"],
      measured_force_N: [144, "f64"],
      depth_mm: [152, "f64"],
      rupture_force_N: [160, "f64"],
      stiffness_scale: [168, "f64"],
      behind_ms: [176, "f64"],
      ruptures: [184, "u32"],
      elements: [188, "u32"],
    },
  },
  field: {
    kind: 11,
    keys: ["model"],
    fields: {
      model: [8, "char[32]"],
      time_ms: [40, "f64"],
      status: [48, "i32"],
      nodes: [52, "u32"],
      stresses: [56, "u32"],
    },
  },
  capture: {
    kind: 12,
    keys: ["tool", "ordinal"],
    fields: {
      tool: [8, "char[32]"],
      ordinal: [40, "f64"],
      acquired_ms: [48, "f64"],
      frame: [56, "f64"],
      kind: [64, "i32"],
      point: [72, "char[32]"],
      position_mm: [104, "f64[3]"],
      covariance_mm2: [128, "f64[9]"],
    },
  },
  alarm: {
    kind: 13,
    keys: ["alarm", "subject"],
    fields: {
      alarm: [8, "char[32]"],
      subject: [40, "char[32]"],
      raised_ms: [72, "f64"],
      changed_ms: [80, "f64"],
      state: [88, "i32"],
      severity: [92, "i32"],
      count: [96, "u32"],
      text: [104, "char[256]"],
    },
  },
  device: {
    kind: 14,
    keys: ["device"],
    fields: {
      device: [8, "char[32]"],
      kind: [40, "i32"],
      status: [44, "i32"],
      taken: [48, "f64"],
      rejected: [56, "f64"],
      lost: [64, "f64"],
      late: [72, "f64"],
      connections: [80, "f64"],
      rate_hz: [88, "f64"],
      stated_rate_hz: [96, "f64"],
      age_ms: [104, "f64"],
      age_sigma_ms: [112, "f64"],
      latency_p50_ms: [120, "f64"],
      latency_p99_ms: [128, "f64"],
      clock_offset_ms: [136, "f64"],
      clock_drift_ppm: [144, "f64"],
      driver_state: [152, "i32"],
      volume_near_mm: [160, "f64"],
      volume_far_mm: [168, "f64"],
      volume_half_width_rad: [176, "f64"],
      volume_half_height_rad: [184, "f64"],
    },
  },
  loop: {
    kind: 15,
    keys: ["loop"],
    fields: {
      loop: [8, "char[32]"],
      rate_hz: [40, "f64"],
      steps: [48, "f64"],
      overruns: [56, "f64"],
      step_p50_us: [64, "f64"],
      step_p99_us: [72, "f64"],
      step_max_us: [80, "f64"],
    },
  },
  health: {
    kind: 16,
    keys: [],
    fields: {
      time_ms: [8, "f64"],
      started_ms: [16, "f64"],
      recorded: [24, "f64"],
      record_dropped: [32, "f64"],
      resident_bytes: [40, "f64"],
      clock_error_ms: [48, "f64"],
      recorder_failing: [56, "u32"],
      clock_steps: [60, "u32"],
      other_wire: [64, "u32"],
    },
  },
  tracked_tool: {
    kind: 17,
    keys: ["device", "tool"],
    fields: {
      device: [8, "char[32]"],
      tool: [40, "char[32]"],
      frame: [72, "f64"],
      acquired_ms: [80, "f64"],
      status: [88, "i32"],
      used_markers: [92, "u32"],
      rotation: [96, "f64[9]"],
      translation_mm: [168, "f64[3]"],
      marker_rms_mm: [192, "f64"],
    },
  },
} as const satisfies Record<string, RecordLayout>;

export const kLayouts: Readonly<Record<RecordName, RecordLayout>> = layouts;

export type RecordName = keyof typeof layouts;

type ValueOf<T> = T extends `char[${number}]` ? string : T extends `f64[${number}]` ? number[] : number;

// The fields of a record as values. Unknown numbers are NaN.
export type RecordOf<N extends RecordName> = {
  -readonly [F in keyof (typeof layouts)[N]["fields"]]: (typeof layouts)[N]["fields"][F] extends readonly [
    number,
    infer T,
  ]
    ? ValueOf<T>
    : never;
};

// What the gateway sends to a browser: the fixed layout of every record of /state, little-endian, without padding
// (docs/gateway.md, which `bregma-gateway --print-layout` writes).
//
// Times are milliseconds of CLOCK_BOOTTIME of the gateway's host ("gateway clock"), whichever clock stated them first.
// Lengths in mm, angles in rad, positions in Image (RAS) unless the field states another frame. NaN: unknown, or not to
// be shown. Poses map tip to Image, unless the field states another, as a rotation matrix, row by row, and the tip's
// position.
//
// A new field goes to the end of its record, a new record gets the next number, and kLayoutVersion grows. A reader
// skips what lies beyond the fields that it knows, and records that it does not know.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

namespace bregma::gateway {

static_assert(std::endian::native == std::endian::little, "records are copied to the socket as they are in memory");

inline constexpr std::uint32_t kFrameMagic = 0x46475242; // "BRGF"
inline constexpr std::uint16_t kLayoutVersion = 4;

using Name = char[32];  // UTF-8, padded with NUL
using Text = char[256]; // the same, at least one NUL

enum class RecordKind : std::uint16_t {
  kPong = 1,
  kLink = 2,
  kCase = 3,
  kSession = 4,
  kTool = 5,
  kRegistration = 6,
  kFiducial = 7,
  kAccuracy = 8,
  kTarget = 9,
  kDeformation = 10,
  kField = 11,
  kCapture = 12,
  kAlarm = 13,
  kDevice = 14,
  kLoop = 15,
  kHealth = 16,
  kTrackedTool = 17,
  kSlice = 18,
  kScanner = 19,
  kScannerCoil = 20,
  kRobotTool = 21,
};

// Begins every binary message.
struct FrameHeader {
  std::uint32_t magic;
  std::uint16_t layout;
  std::uint16_t records;
  std::uint32_t frame;
  std::uint32_t bytes;
  double written_ms;
};

// Begins every record.
struct RecordHeader {
  std::uint16_t kind;
  std::uint16_t flags;
  std::uint32_t bytes;
};
inline constexpr std::uint16_t kEnded = 1; // the instance has ended: remove it; only its name fields have a meaning

struct Pong {
  double client_ms;
  double received_ms;
  double written_ms;
};

struct Link {
  double silent_ms;
  double last_state_ms;
  std::uint32_t presence;
  std::uint32_t changes;
  std::uint32_t wire_generation;
  std::uint32_t wire_revision;
  Name host;
  Text text;
};

struct CaseProgress {
  double fraction;
  std::uint32_t state;
  std::uint32_t reserved;
  char hash[64];
  Name id;
  Text text;
};

struct Session {
  std::int32_t session;
  std::uint32_t reserved;
  double time_ms;
  Text next;
};

struct Tool {
  Name tool;
  double frame;
  double acquired_ms;
  double published_ms;
  double valid_until_ms;
  double age_sigma_ms;
  std::int32_t status;
  std::int32_t session;
  double rotation[9];
  double tip_mm[3];
  double velocity_mm_s[3];
  double covariance[36];
  double position_velocity_covariance_mm2_s[9];
  double velocity_covariance_mm2_s2[9];
  double acceleration_sigma_mm_s2;
  double tre_rms_mm;
  double tre_95_semi_axes_mm[3];
  double tre_95_axes[9];
  Name trajectory;
  double distance_to_target_mm;
  double lateral_deviation_mm;
  double angle_rad;
  double remaining_depth_mm;
  double predicted_target_mm[3];
  double distance_to_predicted_target_mm;
  Name nearest_structure;
  double nearest_structure_mm;
  std::int32_t prediction;
  std::int32_t plausibility;
  std::int32_t plausibility_reason;
  std::int32_t source_kind;
  Name source;
  double nearest_structure_sigma_mm;
};

struct Registration {
  Name reference;
  double time_ms;
  double revision;
  double accepted_revision;
  std::int32_t status;
  std::int32_t reason;
  Name subject;
  Text text;
  double rotation[9];
  double translation_mm[3];
  double accepted_rotation[9];
  double accepted_translation_mm[3];
  std::uint32_t fiducials;
  std::uint32_t surface_samples;
  double fre_mm;
  double fre_expected_mm;
  double surface_rms_mm;
};

struct Fiducial {
  Name fiducial;
  double residual_mm[3];
  double norm_mm;
  double leave_one_out_mm;
  double p_value;
  std::uint32_t suspect;
  std::uint32_t reserved;
};

struct Accuracy {
  Name reference;
  double time_ms;
  double fre_mm;
  double fre_expected_mm;
  double last_check_mm;
  double last_check_limit_mm;
  double drift_statistic;
  double drift_threshold;
  std::uint32_t checks;
  std::uint32_t drift_detected;
};

struct Target {
  Name target;
  double tre_rms_mm;
  double covariance_mm2[9];
  double tre_95_semi_axes_mm[3];
  double tre_95_axes[9];
  double image_rms_mm;
};

struct Deformation {
  Name point;
  double time_ms;
  std::int32_t kind;
  std::int32_t status;
  std::int32_t reason;
  std::int32_t phase;
  double imaged_mm[3];
  double displaced_mm[3];
  double error_bound_mm;
  double von_mises_Pa;
  double tip_force_N;
  double shaft_force_N;
  double measured_force_N;
  double depth_mm;
  double rupture_force_N;
  double stiffness_scale;
  double behind_ms;
  std::uint32_t ruptures;
  std::uint32_t elements;
};

// Followed by the arrays: nodes x 3 float32 of displacement_mm, then stresses float32 of von_mises_Pa, then zeros up to
// a multiple of 8 bytes.
struct FieldHeader {
  Name model;
  double time_ms;
  std::int32_t status;
  std::uint32_t nodes;
  std::uint32_t stresses;
  std::uint32_t reserved;
};

struct Capture {
  Name tool;
  double ordinal;
  double acquired_ms;
  double frame;
  std::int32_t kind;
  std::uint32_t reserved;
  Name point;
  double position_mm[3];
  double covariance_mm2[9];
};

struct Alarm {
  Name alarm;
  Name subject;
  double raised_ms;
  double changed_ms;
  std::int32_t state;
  std::int32_t severity;
  std::uint32_t count;
  std::uint32_t reserved;
  Text text;
};

struct Device {
  Name device;
  std::int32_t kind;
  std::int32_t status;
  double taken;
  double rejected;
  double lost;
  double late;
  double connections;
  double rate_hz;
  double stated_rate_hz;
  double age_ms;
  double age_sigma_ms;
  double latency_p50_ms;
  double latency_p99_ms;
  double clock_offset_ms;
  double clock_drift_ppm;
  std::int32_t driver_state;
  std::uint32_t reserved;
  double volume_near_mm;
  double volume_far_mm;
  double volume_half_width_rad;
  double volume_half_height_rad;
};

struct Loop {
  Name loop;
  double rate_hz;
  double steps;
  double overruns;
  double step_p50_us;
  double step_p99_us;
  double step_max_us;
};

struct Health {
  double time_ms;
  double started_ms;
  double recorded;
  double record_dropped;
  double resident_bytes;
  double clock_error_ms;
  std::uint32_t recorder_failing;
  std::uint32_t clock_steps;
  std::uint32_t other_wire;
  std::uint32_t reserved;
};

struct TrackedTool {
  Name device;
  Name tool;
  double frame;
  double acquired_ms;
  std::int32_t status;
  std::uint32_t used_markers;
  double rotation[9];
  double translation_mm[3];
  double marker_rms_mm;
};

// Followed by columns x rows u16, row by row, then zeros up to a multiple of 8 bytes.
struct SliceHeader {
  Name device;
  double published_ms;
  double number;
  std::uint32_t columns;
  std::uint32_t rows;
  double spacing_mm[2];
  double thickness_mm;
  double rotation[9];
  double translation_mm[3];
  double image_rotation[9];
  double image_translation_mm[3];
  Name protocol;
  std::uint32_t series;
  std::uint32_t index;
  std::uint32_t count;
  std::int32_t correction;
  double max_shift_mm;
  double error_95_mm;
  double extrapolated_fraction;
  double missing_fraction;
  std::int32_t tip_status;
  std::uint32_t reserved;
  Name tip_tool;
  double tip_pixel[2];
  double tip_distance_mm;
  double tip_direction[3];
  double tip_error_95_mm;
};

struct Scanner {
  Name device;
  double time_ms;
  std::int32_t step;
  std::int32_t activity;
  Text text;
  Text next;
  Name protocol;
  std::uint32_t slices;
  std::uint32_t slices_expected;
  double slices_taken;
  double slices_refused;
  double slices_corrected;
  Text refused_text;
  double revision;
  std::int32_t verdict;
  std::int32_t validity;
  Text reason;
  double fre_mm;
  double fre_expected_mm;
  double tre_95_mm;
  double verified_mm;
  double opme_mm;
  double change_mm;
  double change_rad;
  Text validity_text;
  double accepted_revision;
  double accepted_ms;
  double accepted_tre_95_mm;
  double accepted_rotation[9];
  double accepted_translation_mm[3];
  std::uint32_t accepted_corrected;
  std::int32_t field_status;
  Name field;
  double field_made_ms;
  double field_expires_ms;
  double field_points;
  double field_initial_mm;
  double field_residual_mm;
  double field_residual_max_mm;
  double phantom_moved_mm;
};

struct ScannerCoil {
  Name device;
  Name coil;
  std::int32_t outcome;
  std::uint32_t reserved;
  double scanner_mm[3];
  double sigma_mm;
  double residual_mm;
};

struct RobotTool {
  Name device;
  Name tool;
  double frame;
  double acquired_ms;
  double published_ms;
  double valid_until_ms;
  std::int32_t mode;
  std::int32_t status;
  double rotation[9];
  double tip_mm[3];
  double covariance[36];
  std::int32_t scanner_status;
  std::uint32_t reserved;
  Name scanner;
  double scanner_rotation[9];
  double scanner_tip_mm[3];
  double scanner_covariance[36];
  double scanner_error_95_mm;
};

// Client to gateway: one binary message of this layout each.
enum class RequestKind : std::uint32_t { kAcknowledge = 1, kRate = 2, kPing = 3, kField = 4, kSlices = 5 };
struct Request {
  std::uint32_t kind;
  std::uint32_t value;
  double client_ms;
};

} // namespace bregma::gateway

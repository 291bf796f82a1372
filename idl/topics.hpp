// The topic table: name, type and quality of service of every topic of Bregma.
#pragma once

#include <cstdint>

#include "casefiles.h"
#include "control.h"
#include "robot.h"
#include "state.h"
#include "streams.h"

namespace bregma::wire {

#define BREGMA_WIRE_TYPE(Type) using Type = bregma_wire_##Type
BREGMA_WIRE_TYPE(Name);
BREGMA_WIRE_TYPE(Pose);
BREGMA_WIRE_TYPE(TrackedTool);
BREGMA_WIRE_TYPE(TrueTool);
BREGMA_WIRE_TYPE(Ellipsoid);
BREGMA_WIRE_TYPE(FiducialResidual);
BREGMA_WIRE_TYPE(TargetAccuracy);
BREGMA_WIRE_TYPE(DeviceHealth);
BREGMA_WIRE_TYPE(LoopHealth);
BREGMA_WIRE_TYPE(CommandBody);
BREGMA_WIRE_TYPE(BootId);
BREGMA_WIRE_TYPE(PoseCovariance);
// Integers with named constants (bregma_wire_POSE_LIVE): any value may arrive, and 0 is "not stated" (docs/wire.md).
BREGMA_WIRE_TYPE(ToolStatus);
BREGMA_WIRE_TYPE(RobotMode);
BREGMA_WIRE_TYPE(RangeStatus);
BREGMA_WIRE_TYPE(RobotMotionPhase);
BREGMA_WIRE_TYPE(RobotStopCause);
BREGMA_WIRE_TYPE(SessionState);
BREGMA_WIRE_TYPE(PoseStatus);
BREGMA_WIRE_TYPE(Plausibility);
BREGMA_WIRE_TYPE(PlausibilityReason);
BREGMA_WIRE_TYPE(RegistrationStatus);
BREGMA_WIRE_TYPE(RefusalReason);
BREGMA_WIRE_TYPE(DeformationStatus);
BREGMA_WIRE_TYPE(DeformationReason);
BREGMA_WIRE_TYPE(FollowedKind);
BREGMA_WIRE_TYPE(ProbePhase);
BREGMA_WIRE_TYPE(CaptureKind);
BREGMA_WIRE_TYPE(RejectReason);
BREGMA_WIRE_TYPE(DeviceKind);
BREGMA_WIRE_TYPE(DeviceStatus);
BREGMA_WIRE_TYPE(TransitSource);
BREGMA_WIRE_TYPE(ImageDirection);
BREGMA_WIRE_TYPE(CoilState);
BREGMA_WIRE_TYPE(PatientPosition);
BREGMA_WIRE_TYPE(DistortionCorrection);
BREGMA_WIRE_TYPE(ScannerStep);
BREGMA_WIRE_TYPE(ScannerActivity);
BREGMA_WIRE_TYPE(ScannerVerdict);
BREGMA_WIRE_TYPE(ScannerValidity);
BREGMA_WIRE_TYPE(FieldStatus);
BREGMA_WIRE_TYPE(CoilOutcome);
BREGMA_WIRE_TYPE(CoilReport);
BREGMA_WIRE_TYPE(AlarmState);
BREGMA_WIRE_TYPE(AlarmSeverity);
BREGMA_WIRE_TYPE(DriverState);
BREGMA_WIRE_TYPE(CommandKind);
BREGMA_WIRE_TYPE(CommandForm);
BREGMA_WIRE_TYPE(CommandResult);
BREGMA_WIRE_TYPE(CaseOfferState);
BREGMA_WIRE_TYPE(Sha256);
#undef BREGMA_WIRE_TYPE

struct Qos {
  bool reliable;
  bool transient_local;
  int depth;                // samples kept per instance, with transient_local also for readers that join late; 0: all
  std::int64_t deadline_ns; // 0: none. The reader is notified if an instance is silent for longer.
  std::int64_t lease_ns;    // liveliness, automatic; 0: none. A dead process is detected after this time.
};

inline constexpr std::int64_t kMillisecond_ns = 1'000'000;

namespace qos {
// Streams: old samples are useless, so samples are not sent again. A silent device counts as lost.
inline constexpr Qos kTracker{false, false, 8, 200 * kMillisecond_ns, 1'000 * kMillisecond_ns};
inline constexpr Qos kSensor{false, false, 8, 500 * kMillisecond_ns, 1'000 * kMillisecond_ns};
// A permission that arrives late permits nothing, and its silence is what counts: the reader measures it itself.
inline constexpr Qos kDeadman{false, false, 4, 0, 0};
inline constexpr Qos kTruth{false, false, 64, 0, 0};
// A worker that is busy for half a second loses no slice of a series.
inline constexpr Qos kBulkIn{true, false, 64, 0, 0};
// State: the last value of each instance, also for readers that join late. With depth 1 a stalled client cannot fill
// the writer's cache: the next value replaces the last one.
inline constexpr Qos kState{true, true, 1, 0, 1'000 * kMillisecond_ns};
// A display that joins late can draw the complete trace: fiducials, the longest trace (2,000 samples) and checks.
inline constexpr Qos kCaptures{true, true, 4096, 0, 1'000 * kMillisecond_ns};
inline constexpr Qos kControl{true, false, 0, 0, 0};
inline constexpr Qos kPaths{true, false, 4, 0, 0};
// The key is the client: one that does not read loses its own oldest replies, and delays nobody.
inline constexpr Qos kReplies{true, false, 64, 0, 0};
// Files of a case, for displays: a client asks again for what it has not received, so neither side keeps much.
inline constexpr Qos kCaseRequests{true, false, 64, 0, 0};
inline constexpr Qos kCaseChunks{true, false, 64, 0, 0};
} // namespace qos

// X(type, quality of service)
#define BREGMA_TOPICS(X)                                                                                               \
  X(TrackerFrame, kTracker)                                                                                            \
  X(RobotState, kSensor)                                                                                               \
  X(RangeSample, kSensor)                                                                                              \
  X(ForceSample, kSensor)                                                                                              \
  X(RobotMotionState, kSensor)                                                                                         \
  X(RobotPath, kPaths)                                                                                                 \
  X(RobotDeadman, kDeadman)                                                                                            \
  X(RobotPermit, kDeadman)                                                                                             \
  X(ImageSlice, kBulkIn)                                                                                               \
  X(SurfacePoints, kBulkIn)                                                                                            \
  X(NavigationState, kState)                                                                                           \
  X(RegistrationState, kState)                                                                                         \
  X(AccuracyState, kState)                                                                                             \
  X(DeformationState, kState)                                                                                          \
  X(SystemHealth, kState)                                                                                              \
  X(DeformationField, kState)                                                                                          \
  X(CorrectedSlice, kState)                                                                                            \
  X(ScannerRegistration, kState)                                                                                       \
  X(RobotTool, kState)                                                                                                 \
  X(CapturedPoint, kCaptures)                                                                                          \
  X(FiducialReport, kState)                                                                                            \
  X(Alarm, kState)                                                                                                     \
  X(Command, kControl)                                                                                                 \
  X(CommandReply, kReplies)                                                                                            \
  X(SimulatedTruth, kTruth)                                                                                            \
  X(DriverHealth, kState)                                                                                              \
  X(CaseOffer, kState)                                                                                                 \
  X(CaseRequest, kCaseRequests)                                                                                        \
  X(CaseChunk, kCaseChunks)

template <class T> struct Topic;

#define BREGMA_DECLARE_TOPIC(Type, qos_name)                                                                           \
  using Type = bregma_wire_##Type;                                                                                     \
  template <> struct Topic<Type> {                                                                                     \
    static constexpr const char *kName = #Type;                                                                        \
    static constexpr Qos kQos = qos::qos_name;                                                                         \
    static const dds_topic_descriptor_t &descriptor() { return bregma_wire_##Type##_desc; }                            \
  };
BREGMA_TOPICS(BREGMA_DECLARE_TOPIC)
#undef BREGMA_DECLARE_TOPIC

} // namespace bregma::wire

// Stage navigation: reads tracker frames and publishes NavigationState per frame, and at a minimum rate without frames.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "base/parameters.hpp"
#include "server/inputs/input_guard.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/runtime/mailbox.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/navigation/pipeline.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

void declare(base::ParameterSet &set, NavigationParameters &parameters);

class NavigationStage final : public Stage {
public:
  static constexpr const char *kName = "navigation";
  using Parameters = NavigationParameters;
  using Inbox = runtime::Mailbox<NavigationInput, 256>;

  NavigationStage(const NavigationParameters &parameters, const StageContext &context);
  void connect(Inbox &inbox, CaseStore &cases, const runtime::LatestValue<PredictedTargets> &predicted,
               FlangeRing &flanges);

  void step(const Moment &now) noexcept override;
  [[nodiscard]] std::int64_t wake_ns(const Moment &now) const noexcept override;
  [[nodiscard]] std::int64_t budget_ns() const noexcept override { return frame_period_ns_; }

  NavigationEvents events;                            // captures, traces, pivots; for the session
  ReferenceRing references;                           // for the surface scan, in a case with an arm beside the tracker
  runtime::LatestValue<ProbeView> probe;              // per frame
  runtime::LatestValue<TrackingView> tracking;        // a few times per second, like the next
  runtime::LatestValue<inputs::StreamHealth> devices; // trackers
  runtime::LatestValue<ReferenceView> reference;      // beside an arm

private:
  void take_messages(const Moment &now) noexcept;
  void take_flanges(const Moment &now) noexcept;
  // With the publisher's clock and host.
  [[nodiscard]] wire::NavigationState stamped(wire::NavigationState state, const Moment &now) const noexcept;
  [[nodiscard]] bool navigates(int tracker, std::int64_t now_ns) noexcept;
  void publish(const Moment &now) noexcept;
  void share(const Moment &now) noexcept;

  inputs::InputGuard<wire::TrackerFrame> guard_;
  NavigationPipeline pipeline_;
  TrackerVolume volume_; // of every tracker
  Subscriber<wire::TrackerFrame> frames_;
  Publisher<wire::NavigationState> states_;
  Inbox *inbox_ = nullptr;
  CaseLease lease_;
  runtime::LatestInput<PredictedTargets> predicted_;
  FlangeRing *flanges_ = nullptr;
  std::int64_t looked_ns_ = 0; // monotonic, for an arm's measurements
  wire::BootIdentity boot_id_;
  int tracker_ = -1; // index of the one that navigates; -1: none has sent yet
  std::int64_t frame_period_ns_ = 0;
  std::int64_t shared_ns_ = 0;                                            // monotonic
  bool published_ = false;                                                // since the last tick
  std::array<std::uint64_t, bregma_wire_MAX_DEVICES> malformed_bodies_{}; // of each tracker
};

} // namespace bregma::server

#include "server/stages/pose_search/stage.hpp"

#include "server/stages/schedules.hpp"

namespace bregma::server {

PoseSearchStage::PoseSearchStage(const PoseSearchParameters & /*none*/, const StageContext & /*context*/)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = kLookRate_hz, .long_work = true}) {}

void PoseSearchStage::connect(CaseStore &cases, const runtime::LatestValue<PoseSearchRequest> &request) {
  lease_.connect(cases);
  request_.connect(request);
}

void PoseSearchStage::step(const Moment & /*now*/) noexcept {
  if (const auto change = lease_.newer()) {
    search_.handle(*change);
    lease_.take(*change);
  }
  waiting_ = request_.refresh() || waiting_;
  if (!waiting_ || request_.value().generation > lease_.generation()) {
    return;
  }
  waiting_ = false;
  if (const auto found = search_.answer(request_.value())) {
    answer.store(*found);
  }
}

} // namespace bregma::server

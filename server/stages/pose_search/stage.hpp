// Stage pose search: the worker for the registration stage's searches (pose_search.hpp). It checks for a request at its
// rate. A search has no time limit, and no stage waits for it.
#pragma once

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/pose_search/pose_search.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

struct PoseSearchParameters {};
inline void declare(base::ParameterSet & /*set*/, PoseSearchParameters & /*none*/) {}

class PoseSearchStage final : public Stage {
public:
  static constexpr const char *kName = "pose search";
  using Parameters = PoseSearchParameters;

  PoseSearchStage(const PoseSearchParameters &parameters, const StageContext &context);
  void connect(CaseStore &cases, const runtime::LatestValue<PoseSearchRequest> &request);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<PoseSearchAnswer> answer;

private:
  PoseSearch search_;
  CaseLease lease_;
  runtime::LatestInput<PoseSearchRequest> request_;
  bool waiting_ = false; // the request waits for its case
};

} // namespace bregma::server

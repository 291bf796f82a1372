#include "server/stages/registration/stage.hpp"

#include "server/stages/schedules.hpp"

namespace bregma::server {

void declare(base::ParameterSet &set, RegistrationParameters &p) {
  set.number("registration.rate_hz", &p.rate_hz, "Hz", 0.5, 100, "Rate of re-estimation.");
  declare_priority(set, RegistrationStage::kName, p.priority);
}

RegistrationStage::RegistrationStage(const RegistrationParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kFifo,
                    .fifo_priority = static_cast<int>(parameters.priority),
                    .rate_hz = parameters.rate_hz}),
      states_(context.link), reports_(context.link) {}

void RegistrationStage::connect(Inbox &inbox, CaseStore &cases, const runtime::LatestValue<PoseSearchAnswer> &answer) {
  inbox_ = &inbox;
  lease_.connect(cases);
  answer_.connect(answer);
}

void RegistrationStage::step(const Moment &now) noexcept {
  inbox_->take_each([&](const RegistrationInput &input) noexcept {
    const auto *change = std::get_if<CaseChanged>(&input);
    if (change != nullptr) {
      pipeline_.end_states(now.utc_ns);
      states_(pipeline_.state(), now.utc_ns);
      reports_(pipeline_.fiducials(), now.utc_ns);
    }
    pipeline_.handle(input);
    if (change != nullptr) {
      lease_.take(*change);
    }
  });
  if (answer_.refresh()) {
    pipeline_.on(answer_.value());
  }
  pipeline_.step(now.utc_ns);
  if (const PoseSearchRequest *wanted = pipeline_.wanted_search()) {
    search.store(*wanted);
  }
  estimate.store(pipeline_.state());
  states_(pipeline_.state(), now.utc_ns);
  if (pipeline_.report_changed()) {
    reports_(pipeline_.fiducials(), now.utc_ns);
  }
}

} // namespace bregma::server

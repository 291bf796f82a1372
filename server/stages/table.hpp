// The list of stages, each with the outputs that it reads, as one type:
//
//   using Wiring = StageTable<Reads<SensorStage>,
//                             Reads<DeformationStage, &NavigationStage::probe, &SensorStage::force>>;
//
// The constructor of a table makes every stage and then calls connect() of each stage that has a rate and reads
// outputs, in the order of its row. A mismatch does not compile.
#pragma once

#include <memory>
#include <tuple>
#include <vector>

#include "base/parameters.hpp"
#include "server/stages/parameters.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

// A row: a stage, and members of other stages. Outputs: pointers to members.
template <class StageType, auto... Outputs> struct Reads {
  using Type = StageType;
  template <class Find> static void connect(StageType &stage, const Find &find) {
    if constexpr (sizeof...(Outputs) > 0) {
      stage.connect(find(Outputs)...);
    }
  }
};

template <class... Rows> class StageTable {
public:
  static void declare_all(base::ParameterSet &set, StageParameters &parameters) {
    (declare(set, parameters.of<typename Rows::Type::Parameters>()), ...);
  }

  // host and topics must outlive the table.
  StageTable(StageParameters &parameters, Topics &topics, Host &host)
      : stages_(std::make_unique<typename Rows::Type>(parameters.of<typename Rows::Type::Parameters>(),
                                                      StageContext{topics.link(Rows::Type::kName), host})...) {
    const auto find = [this]<class Output, class Owner>(Output Owner::*output) -> Output & {
      return this->template stage<Owner>().*output;
    };
    (connect_if_on<Rows>(find), ...);
  }

  template <class StageType> [[nodiscard]] StageType &stage() { return *std::get<std::unique_ptr<StageType>>(stages_); }
  // In the order of the table.
  [[nodiscard]] std::vector<Stage *> all() { return {&stage<typename Rows::Type>()...}; }

private:
  // A stage that is off reads nothing: its lease would keep every case.
  template <class Row, class Find> void connect_if_on(const Find &find) {
    if (typename Row::Type &one = stage<typename Row::Type>(); one.schedule().rate_hz > 0.0) {
      Row::connect(one, find);
    }
  }

  std::tuple<std::unique_ptr<typename Rows::Type>...> stages_;
};

} // namespace bregma::server

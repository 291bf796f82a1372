// The parameters of all stages, indexed by the type of their struct. Each stage declares its own; wiring.cpp declares
// those of all stages to the program's ParameterSet.
//
//   StageParameters parameters;
//   parameters.of<NavigationParameters>().filter_hz = 0.0;
//
// Threads: one.
#pragma once

#include <any>
#include <map>
#include <typeindex>

namespace bregma::server {

class StageParameters {
public:
  // Default values unless changed. The reference is valid as long as these parameters.
  template <class Parameters> [[nodiscard]] Parameters &of() {
    std::any &slot = slots_[std::type_index(typeid(Parameters))];
    if (!slot.has_value()) {
      slot.emplace<Parameters>();
    }
    return *std::any_cast<Parameters>(&slot);
  }

private:
  std::map<std::type_index, std::any> slots_;
};

} // namespace bregma::server

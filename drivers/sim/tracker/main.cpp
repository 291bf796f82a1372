// bregma-sim-tracker: an optical tracker beside the simulated arm.
#include "drivers/frame/program.hpp"
#include "drivers/sim/tracker/tracker_beside_arm.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  sim::TrackerDevice tracker;
  driver::Settings defaults;
  defaults.device = "Tracker";
  return driver::run(argc, argv,
                     {"bregma-sim-tracker", "a simulated optical tracker beside the simulated arm",
                      "bregma-sim-tracker --set address=tcp://127.0.0.1:4701 --set case=out/face/case", defaults},
                     tracker);
}

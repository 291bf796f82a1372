// bregma-coils: the driver of the coil controller of a registration frame.
#include "drivers/coils/coil_controller.hpp"
#include "drivers/frame/program.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  coils::CoilController controller;
  driver::Settings defaults;
  defaults.device = "Coils";
  defaults.silence_s = 0.0; // it publishes replies only, and finds a silent line by itself
  return driver::run(argc, argv,
                     {"bregma-coils", "the controller of the coils of a registration frame",
                      "bregma-coils --set address=serial:///dev/ttyUSB0?baud=115200 --set frame=frame.toml", defaults},
                     controller);
}

// bregma-arm: the driver of an arm behind a socket.
#include "drivers/arm/arm_driver.hpp"
#include "drivers/frame/program.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  arm::ArmDriver driver;
  driver::Settings defaults;
  defaults.device = "Robot";
  return driver::run(argc, argv,
                     {"bregma-arm", "an arm behind a socket; only simulated arms are moved",
                      "bregma-arm --set address=tcp://127.0.0.1:4700 --set tool=ProbeGuide", defaults},
                     driver);
}

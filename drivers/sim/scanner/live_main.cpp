// bregma-sim-mri: the simulated MR scanner on the wire.
#include "drivers/frame/program.hpp"
#include "drivers/sim/scanner/scanner_on_the_wire.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  sim::scanner::ScannerOnTheWire scanner;
  driver::Settings defaults;
  defaults.device = "Scanner";
  defaults.silence_s = 0.0; // between series it has nothing to send
  return driver::run(argc, argv,
                     {"bregma-sim-mri", "a simulated MR scanner",
                      "bregma-sim-mri --set seed=3 --set folder=scans --set plays_coils=true", defaults},
                     scanner);
}

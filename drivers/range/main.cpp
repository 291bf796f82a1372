// bregma-range: the driver of an infrared range sensor on a serial line.
#include "drivers/frame/program.hpp"
#include "drivers/range/range_sensor.hpp"

int main(int argc, char **argv) {
  using namespace bregma;
  range::RangeSensor sensor;
  driver::Settings defaults;
  defaults.device = "Range";
  return driver::run(argc, argv,
                     {"bregma-range", "an infrared range sensor on a serial line",
                      "bregma-range --set 'address=serial:///dev/ttyUSB0?baud=921600' --set serial_number=A4",
                      defaults},
                     sensor);
}

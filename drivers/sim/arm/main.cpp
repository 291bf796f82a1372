// `bregma-sim-arm`: a simulated arm behind a socket, with a range sensor on its flange if a head lies before it. Prints
// the arm's address for the driver, the sensor's, then every press of the emergency stop and every place to which a
// person leads it. Last, with --scene-port, the address at which a camera beside the arm sees it.
#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>

#include "base/standard_output.hpp"
#include "casefile/arm_files/arm_file.hpp"
#include "drivers/sim/arm/carried_sensor.hpp"
#include "drivers/sim/arm/leading_hand.hpp"
#include "drivers/sim/arm/scene_line.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"

namespace {

namespace asio = boost::asio;
using boost::system::error_code;

volatile std::sig_atomic_t stop_requested = 0;
volatile std::sig_atomic_t emergency_toggled = 0;

struct Options {
  std::string arm = "robots/mz07f.toml";
  std::uint16_t port = 4700;
  bregma::sim::ArmSettings settings;
  double link_mm = 0.0, link_mrad = 0.0;
  std::array<double, 6> start_deg{0.0, 90.0, 0.0, 0.0, -60.0, 0.0};
  std::uint64_t seed = 1;

  std::string face; // a case; empty: no sensor
  bregma::geometry::Vector3d face_at_mm{450.0, 0.0, 150.0};
  double face_yaw_deg = 0.0;
  bregma::sim::FlangeBeam beam;
  bregma::range::Identity sensor{.model = "GP2Y0A21", .serial = "A4"};
  std::string sensor_link, hand;
  bregma::geometry::Vector3d tip_mm{0.0, 0.0, 150.0};
  std::optional<std::uint16_t> scene_port;
};

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

// One connection at a time; further ones wait.
class Server {
public:
  explicit Server(std::uint16_t port) : acceptor_(context_, {asio::ip::address_v4::loopback(), port}) {
    acceptor_.non_blocking(true);
  }
  [[nodiscard]] std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
  [[nodiscard]] bool connected() const { return socket_.has_value(); }
  // True if a driver has connected.
  bool accept() {
    asio::ip::tcp::socket socket(context_);
    error_code error;
    acceptor_.accept(socket, error);
    if (!error) {
      socket.non_blocking(true, error);
      socket.set_option(asio::ip::tcp::no_delay(true), error);
      socket_.emplace(std::move(socket));
    }
    return connected();
  }
  // The received bytes; nullopt: the connection has ended.
  std::optional<std::string_view> read() {
    error_code error;
    const std::size_t size = socket_->read_some(asio::buffer(buffer_), error);
    if (error && error != asio::error::would_block) {
      socket_.reset();
      return std::nullopt;
    }
    return std::string_view(buffer_.data(), size);
  }
  // A driver that does not read loses the connection.
  void write(std::string_view bytes) {
    error_code error;
    while (!bytes.empty() && !error) {
      bytes.remove_prefix(socket_->write_some(asio::buffer(bytes.data(), bytes.size()), error));
    }
    if (error) {
      socket_.reset();
    }
  }

private:
  asio::io_context context_;
  asio::ip::tcp::acceptor acceptor_;
  std::optional<asio::ip::tcp::socket> socket_;
  std::array<char, 4096> buffer_{};
};

// What lies before the arm, if a face does.
struct Before {
  std::optional<bregma::sim::FaceBeforeArm> face;
  std::optional<bregma::sim::CarriedSensor> sensor;
  std::optional<bregma::sim::LeadingHand> hand;
  std::optional<Server> scene;
};

void serve(Before &before, bregma::sim::SimulatedArm &arm, std::int64_t &next_scene_ns) {
  const std::int64_t time_ns = now_ns();
  before.face->advance(time_ns);
  if (before.hand) {
    if (const std::string news = before.hand->serve(arm, time_ns); !news.empty()) {
      std::printf("%s\n", news.c_str());
      std::fflush(stdout);
    }
  }
  const auto time_us = static_cast<std::uint64_t>(time_ns / 1'000);
  before.sensor->serve(arm.true_flange(), before.face->T_base_image, arm.moving(), time_us);
  if (!before.scene) {
    return;
  }
  if (before.scene->connected()) {
    (void)before.scene->read(); // a lost connection is noticed
  }
  if ((before.scene->connected() || before.scene->accept()) && time_ns >= next_scene_ns) {
    constexpr std::int64_t kPeriod_ns = bregma::sim::SimulatedArm::kTicksPerScene * bregma::sim::SimulatedArm::kTick_ns;
    next_scene_ns = std::max(next_scene_ns + kPeriod_ns, time_ns); // after a pause: not made up
    before.scene->write(line_of(bregma::sim::Scene{time_us, arm.true_flange(), before.face->T_base_image}));
  }
}

void serve(Server &server, bregma::sim::SimulatedArm &arm, Before &before) {
  bool was_connected = false;
  std::int64_t next_scene_ns = 0;
  bool pressed = false;
  while (stop_requested == 0) {
    if (emergency_toggled != 0) {
      emergency_toggled = 0;
      pressed = !pressed;
      std::printf("emergency stop %s\n", pressed ? "pressed" : "released");
      std::fflush(stdout);
      pressed ? arm.press_emergency() : arm.release_emergency();
    }
    if (!server.connected()) {
      if (was_connected) {
        arm.disconnect();
      }
      was_connected = server.accept();
      if (was_connected) {
        server.write(arm.connect());
      }
    }
    if (server.connected()) {
      if (const auto bytes = server.read()) {
        const std::string answer = arm.receive(*bytes, now_ns());
        server.write(answer);
      }
    }
    const std::string telemetry = arm.advance(now_ns());
    if (before.face) {
      serve(before, arm, next_scene_ns);
    }
    if (server.connected()) {
      server.write(telemetry);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

int run(const Options &options) {
  const auto nominal = bregma::casefile::read_arm(options.arm);
  if (!nominal) {
    std::fprintf(stderr, "bregma-sim-arm: %s\n", nominal.error().message.c_str());
    return 2;
  }
  bregma::sim::ArmSettings settings = options.settings;
  for (std::size_t i = 0; i < options.start_deg.size(); ++i) {
    settings.start[static_cast<Eigen::Index>(i)] = options.start_deg[i] * static_cast<double>(EIGEN_PI) / 180.0;
  }
  bregma::sim::SimulatedArm arm(
      *nominal, bregma::sim::with_link_errors(*nominal, options.link_mm, 1e-3 * options.link_mrad, options.seed),
      settings);
  Before before;
  const auto fail = [](const bregma::base::Error &error) {
    std::fprintf(stderr, "bregma-sim-arm: %s\n", error.message.c_str());
    return 2;
  };
  if (!options.face.empty()) {
    auto read = bregma::sim::FaceBeforeArm::of_case(
        options.face, options.face_at_mm, options.face_yaw_deg * static_cast<double>(EIGEN_PI) / 180.0, options.seed);
    if (!read) {
      return fail(read.error());
    }
    before.face.emplace(std::move(*read));
    auto opened = bregma::sim::CarriedSensor::open(before.face->head, options.beam, options.sensor, options.sensor_link,
                                                   options.seed);
    if (!opened) {
      return fail(opened.error());
    }
    before.sensor.emplace(std::move(*opened));
    if (!options.hand.empty()) {
      auto led = bregma::sim::LeadingHand::open(options.hand, *before.face, options.tip_mm, arm.stated_flange());
      if (!led) {
        return fail(led.error());
      }
      before.hand.emplace(std::move(*led));
    }
    if (options.scene_port) {
      before.scene.emplace(*options.scene_port);
    }
  }
  Server server(options.port);
  std::printf("tcp://127.0.0.1:%u\n", static_cast<unsigned>(server.port()));
  if (before.sensor) {
    std::printf("%s\n", before.sensor->address().c_str());
  }
  if (before.scene) {
    std::printf("tcp://127.0.0.1:%u\n", static_cast<unsigned>(before.scene->port()));
  }
  std::fflush(stdout);
  serve(server, arm, before);
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  CLI::App app("Simulated arm behind a socket", "bregma-sim-arm");
  Options options;
  app.add_option("--arm", options.arm, "Description of the arm: .toml (Denavit-Hartenberg) or .urdf")
      ->capture_default_str();
  app.add_option("--port", options.port, "TCP port on the loopback interface; 0: any")->capture_default_str();
  app.add_option("--serial", options.settings.serial, "Serial number")->capture_default_str();
  app.add_option("--start-deg", options.start_deg, "Joint angles at the start")->capture_default_str();
  app.add_option("--link-mm", options.link_mm, "Error of each joint axis' position, 1 sigma")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  app.add_option("--link-mrad", options.link_mrad, "Error of each joint axis' direction, 1 sigma")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--max-speed", options.settings.max_speed_mm_s, "mm/s")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str();
  app.add_option("--acceleration", options.settings.acceleration_mm_s2, "mm/s2")
      ->check(CLI::Range(10.0, 5000.0))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "Of the links' errors")->capture_default_str();
  const auto three = [&app](const std::string &name, bregma::geometry::Vector3d &value, const std::string &text) {
    return app
        .add_option_function<std::array<double, 3>>(
            name,
            [&value](const std::array<double, 3> &given) {
              value = {given[0], given[1], given[2]};
            },
            text)
        ->type_name("FLOAT x 3");
  };
  app.add_option("--face", options.face,
                 "A case whose head lies on its back before the arm: the flange carries a range sensor");
  three("--face-at-mm", options.face_at_mm, "The tip of its nose in the arm's base [450 0 150]");
  app.add_option("--face-yaw-deg", options.face_yaw_deg, "Its top, from the base's x about z")->capture_default_str();
  three("--sensor-mm", options.beam.origin_mm, "Origin of the sensor's beam in the flange [0 0 0]");
  three("--beam", options.beam.direction, "Direction of the beam in the flange [0 0 1]");
  app.add_option("--sensor-serial", options.sensor.serial, "Serial number of the sensor")->capture_default_str();
  app.add_option("--sensor-link", options.sensor_link, "Path at which its line appears, as udev names a device");
  app.add_option(
      "--hand", options.hand,
      "A FIFO from which the names of fiducials and landmarks are read, one per line: a person leads the "
      "arm there, so that its tip touches the skin; \"up\" leads away, \"where\" prints where the tip truly is; "
      "\"flange X Y Z RX RY RZ\" leads the flange to its first place, displaced (mm) and turned (degrees); \"patient X "
      "Y Z "
      "SECONDS\" moves the head to this displacement (mm)");
  app.add_option("--scene-port", options.scene_port,
                 "TCP port on the loopback interface for bregma-sim-tracker; 0: any. With --face");
  three("--tip-mm", options.tip_mm, "The tip that touches, in the flange [0 0 150]");
  app.footer("SIGUSR1 presses the emergency stop, and releases it.\n"
             "Examples:\n  bregma-sim-arm --arm robots/mz07f.toml\n"
             "  bregma-arm --set address=tcp://127.0.0.1:4700\n"
             "  bregma-sim-arm --face out/cases/colin27 --sensor-mm 0 0 60 --sensor-link /tmp/range --hand /tmp/hand");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return bregma::base::end_output("bregma-sim-arm", app.exit(error) == 0 ? 0 : 2);
  }
  if (!(options.beam.direction.norm() > 0.0)) {
    std::fprintf(stderr, "bregma-sim-arm: --beam must not be zero\n");
    return 2;
  }
  options.beam.direction.normalize();
  std::signal(SIGINT, [](int) { stop_requested = 1; });
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  std::signal(SIGUSR1, [](int) { emergency_toggled = 1; });
  try {
    return run(options);
  } catch (const std::exception &error) { // a port in use, an arm without closed inverse kinematics
    std::fprintf(stderr, "bregma-sim-arm: %s\n", error.what());
    return 2;
  }
}

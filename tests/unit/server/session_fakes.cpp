#include "session_fakes.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <stdexcept>

#include <gtest/gtest.h>

#include "idl/commands.hpp"
#include "idl/names.hpp"

namespace bregma::server::testing {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

constexpr double kRadiusMm = 80.0;

// A sphere: an octahedron after three subdivisions of each face into four.
surface::TriangleMesh ball(double radius) {
  surface::TriangleMesh mesh;
  mesh.vertices_mm = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int round = 0; round < 3; ++round) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [it, fresh] = middles.try_emplace(std::minmax(a, b), static_cast<int>(mesh.vertices_mm.size()));
      if (fresh) {
        const Vector3d sum =
            mesh.vertices_mm[static_cast<std::size_t>(a)] + mesh.vertices_mm[static_cast<std::size_t>(b)];
        mesh.vertices_mm.emplace_back(sum.normalized());
      }
      return it->second;
    };
    std::vector<Eigen::Vector3i> finer;
    for (const Eigen::Vector3i &t : mesh.triangles) {
      const int a = middle(t[0], t[1]);
      const int b = middle(t[1], t[2]);
      const int c = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], a, c}, {a, t[1], b}, {c, b, t[2]}, {a, b, c}});
    }
    mesh.triangles = std::move(finer);
  }
  for (Vector3d &vertex : mesh.vertices_mm) {
    vertex *= radius;
  }
  return mesh;
}

casefile::NamedPoint on_ball(const std::string &name, const Vector3d &direction) {
  return {name, kRadiusMm * direction.normalized()};
}

} // namespace

fs::path write_case(const fs::path &parent, const std::string &id) {
  casefile::Case c;
  c.folder = parent / id;
  c.id = id;
  c.image = c.folder / "image.nii.gz";
  c.scalp = {"scalp", ball(kRadiusMm)};
  c.brain = {"brain", ball(65.0)};
  c.fiducials = {on_ball("F1", {1, 1, 1}),   on_ball("F2", {-1, 1, 1}), on_ball("F3", {1, -1, 1}),
                 on_ball("F4", {-1, -1, 1}), on_ball("F5", {0, 1, 0}),  on_ball("F6", {1, 0, 0})};
  c.landmarks = {on_ball("L1", {0, 1, 1}), on_ball("L2", {1, 0, 1}), on_ball("L3", {0, 0, 1}),
                 on_ball("L4", {-1, 0, 1}), on_ball("L5", {0, -1, 1})};
  c.targets = {{"Deep", {10.0, -15.0, 20.0}}};
  c.trajectories = {{"Plan", {30.0, 20.0, 70.0}, {10.0, -15.0, 20.0}}};
  for (const auto &[name, role] :
       {std::pair{"Reference", casefile::ToolRole::kReference}, std::pair{"Stylus", casefile::ToolRole::kPointer},
        std::pair{"Probe", casefile::ToolRole::kProbe}}) {
    casefile::ToolModel tool;
    tool.name = name;
    tool.role = role;
    tool.markers_mm = {{0, 0, 0}, {50, 0, 0}, {0, 40, 0}, {30, 60, 0}};
    c.tools.push_back(tool);
  }
  fs::create_directories(c.folder);
  std::ofstream(c.image) << "an image that no session reads";
  const auto saved = casefile::save_case(c);
  EXPECT_TRUE(saved) << saved.error().message;
  return c.folder;
}

FakeLoops::FakeLoops()
    : truth(Eigen::Quaterniond(0.8, 0.1, -0.5, 0.3), Vector3d(12.345678901234567, -34.5, 1.0 / 3.0)) {}

PrepareCase FakeLoops::preparation() {
  return [](const std::shared_ptr<const casefile::Case> &) { return std::make_shared<PreparedCase>(); };
}

void FakeLoops::use_case(std::shared_ptr<const casefile::Case> loaded, std::shared_ptr<PreparedCase> prepared) {
  EXPECT_EQ(loaded != nullptr, prepared != nullptr);
  the_case = std::move(loaded);
}

void FakeLoops::send(const RegistrationMessage &message) {
  registration.push_back(message);
  std::visit(
      [this](const auto &said) {
        if constexpr (requires { said.revision; }) {
          revision = said.revision;
        }
      },
      message);
}

Array3 FakeLoops::in_reference(const Vector3d &image_mm) const {
  const Vector3d point = truth.inverse() * image_mm;
  return {point.x(), point.y(), point.z()};
}

CaptureResult FakeLoops::answer(const CaptureRequest &request) const {
  const auto name = wire::view(request.point);
  const auto *point = request.kind == bregma_wire_CAPTURE_CHECK ? the_case->landmark(name) : the_case->fiducial(name);
  CaptureResult out{};
  out.id = request.id;
  out.status = capture_status;
  out.used_frames = 60;
  out.window_frames = 75;
  out.frame = 4711;
  out.acquired_time_ns = request.start_ns + request.window_ns;
  out.position_mm = in_reference(point->position_mm + miss_mm);
  out.covariance_mm2 = {0.01, 0, 0, 0, 0.02, 0, 0, 0, 0.03};
  out.motion_mm = 0.125;
  return out;
}

RegistrationEstimate FakeLoops::estimate() const {
  RegistrationEstimate out{};
  out.revision = revision;
  out.status = registration_status;
  wire::set_text(out.text, registration_text);
  out.T_image_reference = wire::to_wire(truth);
  for (std::size_t i = 0; i < 6; ++i) {
    const double sigma = i < 3 ? 0.002 : registration_sigma_mm;
    out.covariance[7 * i] = sigma * sigma;
  }
  out.fre_mm = 0.75;
  return out;
}

std::vector<PivotPose> FakeLoops::pivot(std::uint64_t id, double sigma_mm, double angle_rad, unsigned seed) const {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, sigma_mm);
  const Vector3d dimple(100.0, -50.0, -1500.0);
  std::vector<PivotPose> poses;
  for (int i = 0; i < 400; ++i) {
    const double phase = 2.0 * std::numbers::pi * i / 100.0;
    const Vector3d turn = angle_rad * Vector3d(std::sin(phase), std::cos(1.3 * phase), 0.3 * std::sin(0.7 * phase));
    const Eigen::Quaterniond rotation = geometry::rotation_exp(turn);
    const Vector3d at = dimple - rotation * tip_mm + Vector3d(noise(random), noise(random), noise(random));
    const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> T(rotation, at);
    PivotPose pose{};
    pose.id = id;
    pose.frame = static_cast<std::uint64_t>(i);
    pose.acquired_time_ns = 20'000'000LL * i;
    pose.T_tracker_tool = wire::to_wire(T);
    poses.push_back(pose);
  }
  return poses;
}

SessionHarness::SessionHarness(const fs::path &folder, FakeLoops &fakes, Executor executor) : loops(fakes) {
  config.state_directory = folder / "state";
  session = std::make_unique<Session>(config, loops, std::move(executor));
}

wire::Command SessionHarness::command(wire::CommandKind kind, const std::string &first, const std::string &second) {
  wire::Command out{};
  EXPECT_TRUE(wire::set_name(out.client, "test"));
  out.id = next_id_++;
  out.sent_time_ns = now_ns;
  const auto fields = wire::fields_of(wire::find_command(kind)->form);
  const std::array<std::string_view, 2> values{first, second};
  // A client may leave a value empty: it is for the session to refuse it.
  const std::string wrong =
      wire::fill_command(out, kind, std::span(values).first(std::min(fields.size(), values.size())));
  EXPECT_TRUE(wrong.empty() || wrong.ends_with(" is empty")) << wrong;
  return out;
}

std::optional<wire::CommandReply> SessionHarness::send(const wire::Command &command) {
  const std::size_t before = loops.replies.size();
  session->handle(command, now_ns);
  run(400.0);
  for (std::size_t i = before; i < loops.replies.size(); ++i) {
    if (loops.replies[i].id == command.id) {
      return loops.replies[i];
    }
  }
  return std::nullopt;
}

void SessionHarness::run(double milliseconds) {
  for (double passed = 0.0; passed < milliseconds; passed += 50.0) {
    now_ns += 50'000'000;
    for (; answering && answered_ < loops.navigation.size(); ++answered_) {
      if (const auto *request = std::get_if<CaptureRequest>(&loops.navigation[answered_])) {
        session->on(NavigationEvent(loops.answer(*request)), now_ns);
      }
    }
    if (answering && loops.revision > 0) {
      session->on(loops.estimate(), now_ns);
    }
    session->poll(now_ns);
  }
}

wire::CommandReply SessionHarness::ask(wire::CommandKind kind, const std::string &first, const std::string &second) {
  const auto reply = send(command(kind, first, second));
  EXPECT_TRUE(reply) << "no reply to command " << kind;
  return reply.value_or(wire::CommandReply{});
}

wire::CommandReply SessionHarness::done(wire::CommandKind kind, const std::string &first, const std::string &second) {
  const auto reply = ask(kind, first, second);
  EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  return reply;
}

void SessionHarness::condition(const char *kind, const char *subject, bool active, SessionEffect effect,
                               const char *text) {
  AlarmCondition out{};
  EXPECT_TRUE(wire::set_name(out.kind, kind) && wire::set_name(out.subject, subject));
  out.active = active;
  out.severity = bregma_wire_SEVERITY_CRITICAL;
  out.effect = effect;
  out.time_ns = now_ns;
  wire::set_text(out.text, text);
  session->on(out, now_ns);
}

void SessionHarness::trace(const std::string &tool, int samples) {
  for (int i = 0; i < samples; ++i) {
    SurfaceSample sample{};
    EXPECT_TRUE(wire::set_name(sample.tool, tool));
    sample.frame = static_cast<std::uint64_t>(i);
    sample.acquired_time_ns = now_ns;
    const double angle = 0.1 * i;
    sample.position_mm = loops.in_reference(kRadiusMm * Vector3d(std::cos(angle), std::sin(angle), 0.0));
    sample.covariance_mm2 = {0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1};
    session->on(NavigationEvent(sample), now_ns);
  }
}

void SessionHarness::pivot(const std::string &tool) {
  done(bregma_wire_COMMAND_START_PIVOT, tool);
  for (const PivotPose &pose : loops.pivot(FakeLoops::last<PivotRequest>(loops.navigation).id, 0.1, 0.6, 7)) {
    session->on(NavigationEvent(pose), now_ns);
  }
  done(bregma_wire_COMMAND_FINISH_PIVOT, tool);
}

void SessionHarness::check_landmarks() {
  for (const char *landmark : {"L1", "L2", "L3"}) {
    done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", landmark);
  }
}

void SessionHarness::up_to(wire::SessionState stage, const fs::path &case_folder) {
  const std::array<std::function<void()>, 6> steps{
      [] {},
      [&] { done(bregma_wire_COMMAND_LOAD_CASE, case_folder.string()); },
      [&] {
        pivot("Stylus");
        done(bregma_wire_COMMAND_START_REGISTRATION);
      },
      [&] {
        for (const char *fiducial : {"F1", "F2", "F3", "F4"}) {
          done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", fiducial);
        }
        done(bregma_wire_COMMAND_START_TRACE, "Stylus");
        trace("Stylus", 20);
        done(bregma_wire_COMMAND_STOP_TRACE, "Stylus");
        done(bregma_wire_COMMAND_ACCEPT_REGISTRATION);
      },
      [&] {
        check_landmarks();
        done(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
      },
      [&] { done(bregma_wire_COMMAND_START_NAVIGATION, "Stylus", "Plan"); }};
  for (int step = session->state() + 1; step <= stage; ++step) {
    steps[static_cast<std::size_t>(step - bregma_wire_SESSION_IDLE)]();
    ASSERT_EQ(session->state(), step);
  }
}

} // namespace bregma::server::testing

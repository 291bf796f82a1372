// Connections between the stages: which stage reads which output of which other stage.
#include "server/wiring.hpp"

#include <set>
#include <stdexcept>
#include <string>

#include "algorithms/geometry/angles.hpp"
#include "server/inputs/device_names.hpp"
#include "server/stages/deformation/stage.hpp"
#include "server/stages/echo/stage.hpp"
#include "server/stages/health/stage.hpp"
#include "server/stages/monitoring/stage.hpp"
#include "server/stages/navigation/stage.hpp"
#include "server/stages/pose_search/stage.hpp"
#include "server/stages/registration/stage.hpp"
#include "server/stages/robot_motion/stage.hpp"
#include "server/stages/robot_tool/stage.hpp"
#include "server/stages/scanner/stage.hpp"
#include "server/stages/sensors/stage.hpp"
#include "server/stages/session/stage.hpp"
#include "server/stages/surface_scan/stage.hpp"
#include "server/stages/table.hpp"
#include "server/stages/tissue_model/stage.hpp"

namespace bregma::server {

using Stages = StageTable< //
    Reads<NavigationStage, &SessionStage::to_navigation, &SessionStage::cases, &DeformationStage::predicted,
          &SensorStage::flanges_to_navigation>,
    Reads<SensorStage>,
    Reads<SurfaceScanStage, &SessionStage::to_scan, &SensorStage::flanges_to_scan, &SensorStage::readings,
          &NavigationStage::references>,
    Reads<RobotToolStage, &SensorStage::robots, &ScannerStage::pose>,
    Reads<RobotMotionStage, &SessionStage::to_arm, &SessionStage::cases, &SensorStage::robots,
          &NavigationStage::tracking, &RegistrationStage::estimate, &NavigationStage::reference>,
    Reads<ScannerStage, &SessionStage::to_scanner, &RobotToolStage::tools>,
    Reads<RegistrationStage, &SessionStage::to_registration, &SessionStage::cases, &PoseSearchStage::answer>,
    Reads<PoseSearchStage, &SessionStage::cases, &RegistrationStage::search>,
    Reads<TissueModelStage, &SessionStage::cases>,
    Reads<MonitoringStage, &SessionStage::to_monitoring, &SessionStage::cases, &NavigationStage::tracking,
          &NavigationStage::devices, &SensorStage::devices, &RegistrationStage::estimate>,
    Reads<DeformationStage, &SessionStage::cases, &TissueModelStage::model, &NavigationStage::probe,
          &SensorStage::force>,
    Reads<SessionStage, &NavigationStage::events, &MonitoringStage::conditions, &RegistrationStage::estimate,
          &ScannerStage::answers, &ScannerStage::conditions, &SurfaceScanStage::events, &SurfaceScanStage::conditions,
          &RobotMotionStage::answers, &RobotMotionStage::conditions>,
    Reads<EchoStage, &NavigationStage::probe>,
    Reads<HealthStage, &NavigationStage::devices, &SensorStage::devices, &ScannerStage::devices, &SessionStage::view,
          &NavigationStage::events, &MonitoringStage::conditions, &MonitoringStage::clock>>;

struct Wiring::Table : Stages {
  using Stages::Stages;
};

void declare_stages(base::ParameterSet &set, StageParameters &parameters) { Stages::declare_all(set, parameters); }

base::Result<void> check_stages(StageParameters &parameters) {
  const auto &trackers = parameters.of<NavigationParameters>().trackers;
  const auto &sensors = parameters.of<SensorParameters>();
  if (inputs::split_names(trackers).empty() && inputs::split_names(sensors.robots).empty()) {
    return base::failure("devices.trackers = \"\": at least one tracker or one robot is needed");
  }
  const auto &scanner = parameters.of<ScannerParameters>();
  return inputs::check_device_names({{"devices.trackers", trackers},
                                     {"devices.scanner", scanner.device},
                                     {"devices.coils", scanner.coils},
                                     {"devices.robots", sensors.robots},
                                     {"devices.forces", sensors.forces},
                                     {"devices.ranges", sensors.ranges}});
}

Wiring::Wiring(StageParameters &parameters, Topics &topics, Host &host) {
  if (const auto ok = check_stages(parameters); !ok) {
    throw std::invalid_argument(ok.error().message);
  }
  // The error of an arm that states none is the same wherever its poses are used.
  const auto &robot = parameters.of<RobotToolParameters>();
  const ToolPoseOptions arm{robot.flange_sigma_mm, robot.flange_sigma_deg * geometry::kRadiansPerDegree};
  parameters.of<NavigationParameters>().arm = arm;
  parameters.of<SurfaceScanParameters>().arm = arm;
  parameters.of<RobotMotionParameters>().arm = arm;
  table_ = std::make_unique<Table>(parameters, topics, host);
  std::set<std::string_view> names;
  for (Stage *stage : table_->all()) {
    if (!names.insert(stage->name()).second) {
      throw std::invalid_argument(std::string("stage ") + stage->name() + ": two stages have this name");
    }
    if (stage->schedule().rate_hz > 0.0) {
      stages_.push_back(stage);
    }
  }
  if (stages_.size() > bregma_wire_MAX_LOOPS) {
    throw std::invalid_argument("stages: " + std::to_string(stages_.size()) + " are wired, at most " +
                                std::to_string(bregma_wire_MAX_LOOPS) + " can be shown in SystemHealth");
  }
}

Wiring::~Wiring() = default;

Stage *Wiring::find(std::string_view name) const {
  for (Stage *stage : table_->all()) {
    if (stage->name() == name) {
      return stage;
    }
  }
  return nullptr;
}

const Session &Wiring::session() const { return table_->stage<SessionStage>().session(); }

} // namespace bregma::server

// The file of what an arm carries: calibrations as `bregma calibrate` writes them, and what is refused of them.
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "casefile/robot_tools.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::casefile {
namespace {

constexpr const char *kTool = "[[tools]]\nname = \"Pointer\"\ntip_mm = [0, 0, 150]\nsigma_mm = 0.1\n";
constexpr const char *kSensor = "[[sensors]]\nname = \"Range\"\nbeam = \"beam.json\"\ncurve = \"curve.json\"\n";

class RobotEquipmentFile : public testing::Test {
protected:
  void write(const std::string &name, const std::string &text) const { std::ofstream(folder_.path() / name) << text; }
  // A matrix with this text on the diagonal.
  static std::string diagonal(int size, const std::string &variance) {
    std::string out;
    for (int row = 0; row < size; ++row) {
      out += row > 0 ? ", [" : "[";
      for (int column = 0; column < size; ++column) {
        out += std::string(column > 0 ? ", " : "") + (row == column ? variance : "0");
      }
      out += "]";
    }
    return out;
  }
  void write_beam(const std::string &accepted, const std::string &direction) const {
    const std::string rows = diagonal(6, "0.01");
    write("beam.json", "{\"accepted\": " + accepted +
                           ", \"text\": \"refused: a fixed orientation\", \"origin_mm\": "
                           "[12, -8, 60], \"direction\": " +
                           direction + ", \"covariance\": [" + rows + "]}");
  }
  void write_curve(double exponent, const std::string &covariance = "[0.0001, 0], [0, 0.0001]") const {
    write("curve.json",
          "{\"accepted\": true, \"text\": \"accepted\", \"rms_mm\": 0.7, \"scale_mm\": 1.1, \"exponent\": " +
              std::to_string(exponent) + ", \"covariance\": [" + covariance + "]}");
  }
  // turn: the first entry of Y, 1 for a rotation. variance: on the diagonal.
  void write_hand_eye(const std::string &turn, const std::string &variance) const {
    const std::string joint = diagonal(12, variance);
    const std::string rest = ", 0, 0, 10], [0, 1, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]]";
    write("hand_eye.json", R"({"accepted": true, "text": "accepted", "X": [[1)" + rest + R"(, "Y": [[)" + turn + rest +
                               R"(, "covariance_joint": [)" + joint + "]}");
  }
  [[nodiscard]] base::Result<RobotEquipment> read(const std::string &text) const {
    write("robot.toml", text);
    return read_robot_equipment(folder_.path() / "robot.toml");
  }
  [[nodiscard]] std::string error(const std::string &text) const {
    const auto equipment = read(text);
    return equipment ? std::string() : equipment.error().message;
  }

private:
  test::TemporaryFolder folder_;
};

TEST_F(RobotEquipmentFile, ReadsTheCalibrationsOfASensor) {
  write_beam("true", "[0, 0, 1]");
  write_curve(0.98);
  const auto equipment = read(std::string(kTool) + kSensor + "window = 200\ndelay_ms = 38.3\nfar_mm = 300\n");
  ASSERT_TRUE(equipment) << equipment.error().message;
  ASSERT_EQ(equipment->sensors.size(), 1U);
  const RangeSensorModel &sensor = equipment->sensors.front();
  EXPECT_EQ(sensor.name, "Range");
  EXPECT_EQ(sensor.origin_mm, Eigen::Vector3d(12, -8, 60));
  EXPECT_EQ(sensor.direction, Eigen::Vector3d::UnitZ());
  EXPECT_EQ(sensor.covariance(3, 3), 0.01);
  ASSERT_TRUE(sensor.curve);
  EXPECT_EQ(sensor.curve->law.exponent, 0.98);
  EXPECT_EQ(sensor.curve->rms_mm, 0.7);
  EXPECT_EQ(sensor.curve->corrected_rms_mm, 0.7) << "a curve without corrections";
  EXPECT_EQ(sensor.excess_mm, 5.0);
  EXPECT_EQ(sensor.window, 200);
  EXPECT_EQ(sensor.far_mm, 300.0);
}

TEST_F(RobotEquipmentFile, ReadsTheCorrectionsOfACurve) {
  write_beam("true", "[0, 0, 1]");
  const auto with = [&](const std::string &rest) {
    write("curve.json", R"({"accepted": true, "rms_mm": 0.7, "scale_mm": 1.1, "exponent": 0.98, )" + rest + "}");
  };
  const std::string covariance = R"("covariance": [[0.0001, 0], [0, 0.0001]])";
  with(covariance + R"(, "corrected_rms_mm": 0.2, "corrections": [{"reading": 150, "add_mm": 0.5},
       {"reading": 170, "add_mm": -0.5}])");
  const auto equipment = read(std::string(kTool) + kSensor + "excess_mm = 0\n");
  ASSERT_TRUE(equipment) << equipment.error().message;
  const RangeSensorModel &sensor = equipment->sensors.front();
  EXPECT_EQ(sensor.excess_mm, 0.0);
  EXPECT_EQ(sensor.curve->corrected_rms_mm, 0.2);
  EXPECT_DOUBLE_EQ(sensor.curve->corrected().distance_mm(160.0), sensor.curve->law.distance_mm(160.0));
  EXPECT_DOUBLE_EQ(sensor.curve->corrected().distance_mm(150.0), sensor.curve->law.distance_mm(150.0) + 0.5);

  std::string many;
  for (int i = 0; i < 17; ++i) {
    many += (i > 0 ? ", " : "") + std::string(R"({"add_mm": 0.1, "reading": )") + std::to_string(150 + i) + "}";
  }
  with(covariance + R"(, "corrections": [)" + many + "]");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("has 17, at most 16"), std::string::npos);
  with(covariance + R"(, "corrections": [{"reading": 150}])");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("must hold reading and add_mm"), std::string::npos);
  with(R"("covariance": "small")");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("covariance: must be two rows of two numbers"), std::string::npos);
  with(covariance + R"(, "corrected_rms_mm": "none")");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("corrected_rms_mm: must be a number that is not below 0"),
            std::string::npos);
  with(R"("corrections": [])");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("covariance must be there"), std::string::npos);
}

TEST_F(RobotEquipmentFile, ReadsTheArmsLinksTheTableAndTheSizesOfTools) {
  const auto without = read(kTool);
  ASSERT_TRUE(without) << without.error().message;
  EXPECT_FALSE(without->arm);
  EXPECT_FALSE(without->table_z_mm);
  EXPECT_EQ(without->tools.front().radius_mm, 6.0);
  const std::string arm = std::string("arm = \"") + BREGMA_SOURCE_DIR + "/robots/mz07f.toml\"\ntable_mm = -20\n";
  const auto with = read(arm + kTool + "radius_mm = 4\n");
  ASSERT_TRUE(with) << with.error().message;
  ASSERT_TRUE(with->arm);
  EXPECT_EQ(with->arm->name(), "Nachi MZ07F");
  EXPECT_EQ(with->table_z_mm, -20.0);
  EXPECT_EQ(with->tools.front().radius_mm, 4.0);
  EXPECT_NE(error(std::string("arm = \"none.toml\"\n") + kTool).find("none.toml"), std::string::npos);
}

TEST_F(RobotEquipmentFile, RefusesCalibrationsThatWereRefusedOrAreOthers) {
  write_curve(1.0);
  EXPECT_NE(error(std::string(kTool) + kSensor).find("is no result of `bregma calibrate beam --json`"),
            std::string::npos);
  write_beam("false", "[0, 0, 1]");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("this calibration was refused: refused: a fixed orientation"),
            std::string::npos);
  write_beam("true", "[0, 0, 2]");
  EXPECT_NE(error(std::string(kTool) + kSensor).find("is no beam"), std::string::npos);
  write_beam("true", "[0, 0, 1]");
  EXPECT_EQ(error(std::string(kTool) + kSensor), "");
  write_curve(-1.19);
  EXPECT_NE(error(std::string(kTool) + kSensor).find("is the curve of a voltage: it belongs to the driver"),
            std::string::npos);
  write_curve(1.0, "[0.0001, 0], [1, 8]"); // found by fuzzing
  EXPECT_NE(error(std::string(kTool) + kSensor).find("covariance must be there and a covariance"), std::string::npos);
  write_curve(1.0);
  EXPECT_NE(error(std::string(kTool) + kSensor + "near_mm = 900\nfar_mm = 300\n").find("must be below far_mm"),
            std::string::npos);
  EXPECT_NE(error(std::string(kTool) + kSensor + kSensor).find("name = \"Range\": appears twice"), std::string::npos);
}

TEST_F(RobotEquipmentFile, ReadsTheHandEyeCalibrationOfATrackerBesideTheArm) {
  const std::string hand_eye = std::string(kTool) + "[hand_eye]\nfile = \"hand_eye.json\"\ntracker = \"Tracker\"\n";
  EXPECT_FALSE(read(kTool)->hand_eye);
  write_hand_eye("1", "0.01");
  const auto equipment = read(hand_eye + "flange_body = \"Marker\"\n");
  ASSERT_TRUE(equipment) << equipment.error().message;
  ASSERT_TRUE(equipment->hand_eye);
  EXPECT_EQ(equipment->hand_eye->tracker, "Tracker");
  EXPECT_EQ(equipment->hand_eye->flange_body, "Marker");
  EXPECT_EQ(equipment->hand_eye->T_base_tracker.pose.translation(), Eigen::Vector3d(10, 20, 30));
  EXPECT_EQ(equipment->hand_eye->T_base_tracker.covariance(5, 5), 0.01);
  write_hand_eye("2", "0.01");
  EXPECT_NE(error(hand_eye).find("X or Y is no rigid motion"), std::string::npos);
  write_hand_eye("1", "-0.01");
  EXPECT_NE(error(hand_eye).find("covariance_joint is no covariance"), std::string::npos);
  write("hand_eye.json", R"({"accepted": true, "X": [[1, 0, 0, 0]]})");
  EXPECT_NE(error(hand_eye).find("from motions alone"), std::string::npos);
  write("hand_eye.json", R"({"accepted": false, "text": "rotations about one axis"})");
  EXPECT_NE(error(hand_eye).find("was refused: rotations about one axis"), std::string::npos);
}

} // namespace
} // namespace bregma::casefile

// Who a DICOM header names, and where that is kept.
#include "casefile/volumes/patient.hpp"

#include <cstdlib>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "files.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

class PatientTest : public ::testing::Test {
protected:
  void SetUp() override {
    const fs::path archive = test::shared_data() / "images/dicom_mr_oblique_384.tgz";
    if (!fs::exists(archive) ||
        std::system(("tar -xzf '" + archive.string() + "' -C '" + folder_.path().string() + "'").c_str()) != 0) {
      GTEST_SKIP() << "needs " << archive;
    }
  }
  [[nodiscard]] fs::path series() const { return folder_ / "dicoms"; }
  // The first slice, with one part replaced, alone in a folder.
  fs::path changed(const std::string &from, const std::string &to) {
    std::string bytes = test::read_bytes(series() / "N2D_0001.dcm");
    const auto at = bytes.find(from);
    EXPECT_NE(at, std::string::npos);
    fs::create_directory(folder_ / "changed");
    test::write_bytes(folder_ / "changed/slice.dcm", bytes.replace(at, from.size(), to));
    return folder_ / "changed";
  }
  test::TemporaryFolder folder_;
};

TEST_F(PatientTest, IsReadFromTheHeader) {
  const auto patient = read_patient(series(), {});
  ASSERT_TRUE(patient);
  EXPECT_EQ(patient->name, "Jane_Doe");
  EXPECT_EQ(patient->id, "02");
  EXPECT_EQ(patient->birth_date, "1966-01-01");
  EXPECT_FALSE(read_patient(series(), "1.2.3.another.series"));
}

TEST_F(PatientTest, NamesAreShownAsFamilyAndGiven) {
  EXPECT_EQ(read_patient(changed("Jane_Doe", "Doe^Jane"), {})->name, "Doe, Jane");
}

TEST_F(PatientTest, ADeIdentifiedImageHasNone) {
  const std::string sequence("\x18\x00\x20\x00", 4); // (0018,0020)
  const std::string removed("\x12\x00\x62\x00\x04\x00\x00\x00YES ", 12);
  EXPECT_FALSE(read_patient(changed(sequence, removed + sequence), {}));
}

TEST_F(PatientTest, WhatIsNoDicomHasNone) {
  test::write_bytes(folder_ / "image.nii", "no DICOM");
  EXPECT_FALSE(read_patient(folder_ / "image.nii", {}));
  EXPECT_FALSE(read_patient(folder_ / "missing", {}));
}

TEST_F(PatientTest, IsKeptInAFileThatOthersCannotRead) {
  ASSERT_TRUE(write_patient(folder_.path(), {"Doe, Jane", "02", "1966-01-01"}));
  const fs::path file = folder_ / kPatientFile;
  EXPECT_EQ(fs::status(file).permissions() & fs::perms::others_all, fs::perms::none);
  const auto json = nlohmann::json::parse(test::read_bytes(file));
  EXPECT_EQ(json, nlohmann::json::parse(R"({"name": "Doe, Jane", "id": "02", "birth_date": "1966-01-01"})"));
  EXPECT_FALSE(write_patient(folder_ / "missing", {"a", "b", "c"}));
}

} // namespace
} // namespace bregma::casefile

#include <cstdlib>
#include <filesystem>

#include <gtest/gtest.h>

#include "casefile/poses.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;
using Eigen::Vector3d;

const std::string kQuarterTurn = "0 -1 0 10\r\n1 0 0 20\r\n0 0 1 30\r\n0 0 0 1\r\n";

// The message after the path of the file or folder.
template <class T> std::string message_after(const bregma::base::Result<T> &result, const std::filesystem::path &path) {
  const std::string message = result ? "no error" : result.error().message;
  EXPECT_EQ(message.rfind(path.string(), 0), 0U) << "not named: " << message;
  return message.substr(std::min(message.size(), path.string().size()));
}

TEST(PoseMatrices, AFolderIsReadInTheOrderOfTime) {
  TemporaryFolder folder;
  folder.write("2000.txt", "1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n");
  folder.write("1000.txt", kQuarterTurn);
  folder.write("README.md", "not a pose");
  const auto series = read_pose_matrices(folder.path());
  ASSERT_TRUE(series) << series.error().message;
  ASSERT_EQ(series->poses.size(), 2U);
  EXPECT_EQ(series->poses[0].time_ns, 1000);
  EXPECT_TRUE((series->poses[0].pose * Vector3d(1, 0, 0)).isApprox(Vector3d(10, 21, 30), 1e-12));
  EXPECT_EQ(series->poses[1].pose.translation(), Vector3d(1, 2, 3));
}

TEST(PoseMatrices, ErrorsNameFileLineAndValue) {
  const auto error_of = [](const std::string &name, const std::string &content) {
    TemporaryFolder folder;
    const auto file = folder.write(name, content);
    return message_after(read_pose_matrices(folder.path()), file);
  };
  EXPECT_EQ(error_of("1.txt", "0 -1 0 10\n1 0 zero 20\n"), ":2: \"zero\" is not a finite number");
  EXPECT_EQ(error_of("1.txt", "0 -1 0 10\n1 0 nan 20\n"), ":2: \"nan\" is not a finite number");
  EXPECT_EQ(error_of("1.txt", "0 -1 0\n"), ":1: a row of the matrix has 4 numbers, this one has 3");
  EXPECT_EQ(error_of("1.txt", "0 -1 0 10\n1 0 0 20\n"), ": a transform has 16 numbers, this one has 8");
  EXPECT_EQ(error_of("1.txt", "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n"),
            ": the matrix is not a rotation: its rows are not perpendicular unit vectors");
  EXPECT_EQ(error_of("1.txt", "-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"), ": the matrix is not a rotation: it mirrors");
  EXPECT_EQ(error_of("1.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n1 0 0 1\n"), ": the last row of the matrix must be 0 0 0 1");
  EXPECT_NE(error_of("first.txt", kQuarterTurn).find("name must be the time of the pose in ns"), std::string::npos);
  TemporaryFolder empty;
  EXPECT_NE(message_after(read_pose_matrices(empty.path()), empty.path()).find("holds no poses"), std::string::npos);
  EXPECT_EQ(read_pose_matrices("/no/such").error().message, "/no/such: no such file or folder");
  const auto text = empty.write("text.tgz", "not an archive");
  EXPECT_NE(message_after(read_pose_matrices(text), text).find("cannot be read as an archive"), std::string::npos);
}

TEST(PoseMatrices, ARealArchiveIsReadAndATruncatedOneRefused) {
  BREGMA_SHARED_DATA(archive, "tracker/pivot_optical/poses_1151.tgz");
  const auto series = read_pose_matrices(archive);
  ASSERT_TRUE(series) << series.error().message;
  EXPECT_EQ(series->poses.size(), 1151U);
  EXPECT_EQ(series->poses.front().time_ns, 1378476416922755200);
  TemporaryFolder folder;
  const std::string whole = bregma::tests::read_file(archive);
  const auto cut = folder.write("cut.tgz", whole.substr(0, whole.size() / 2));
  EXPECT_NE(message_after(read_pose_matrices(cut), cut).find("cannot be read as an archive"), std::string::npos);
  // Its last byte, and its checksum.
  std::string wrong = whole;
  wrong[wrong.size() - 6] ^= 1;
  for (const std::string &bytes : {whole.substr(0, whole.size() - 1), wrong}) {
    const auto damaged = folder.write("damaged.tgz", bytes);
    EXPECT_NE(message_after(read_pose_matrices(damaged), damaged).find("compressed data end early or do not match"),
              std::string::npos);
  }
}

// Between two files of it an archive may be cut without a trace, but for the mark at its end.
TEST(PoseMatrices, AnArchiveWithoutItsEndMarkIsRefused) {
  TemporaryFolder folder;
  const auto pose = folder.write("1378476416922755200.txt", kQuarterTurn);
  const std::string file = (folder.path() / "poses.tar").string();
  ASSERT_EQ(
      std::system(("tar -cf '" + file + "' -C '" + folder.path().string() + "' " + pose.filename().string()).c_str()),
      0);
  ASSERT_TRUE(read_pose_matrices(file));
  std::filesystem::resize_file(file, 1024); // its header and its content
  EXPECT_EQ(message_after(read_pose_matrices(file), file), ": is not whole: the archive has no end mark");
}

const std::string kHeader = "ObjectType = Image\nNDims = 3\n";
const std::string kEnd = "ElementDataFile = LOCAL\n";
const std::string kIdentity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";

std::string frame(int number, const std::string &name, const std::string &matrix, const std::string &status = "OK") {
  const std::string prefix = "Seq_Frame000" + std::to_string(number) + "_";
  return prefix + name + "Transform = " + matrix + " \n" + prefix + name + "TransformStatus = " + status + "\n" +
         prefix + "Timestamp = " + std::to_string(number) + ".5\n";
}

TEST(TransformSequence, NamesStatusesTimesAndChains) {
  TemporaryFolder folder;
  const auto file = folder.write(
      "a.igs.mha", kHeader + frame(0, "StylusToTracker", "0 -1 0 10 1 0 0 20 0 0 1 30 0 0 0 1") +
                       frame(0, "ReferenceToTracker", "1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1") +
                       frame(1, "StylusToTracker", kIdentity, "INVALID") + frame(1, "ReferenceToTracker", kIdentity) +
                       frame(2, "StylusToTracker", kIdentity) + "ElementDataFile = LOCAL\n\x01\xff no text");
  const auto sequence = read_transform_sequence(file);
  ASSERT_TRUE(sequence) << sequence.error().message;
  EXPECT_EQ(sequence->names(), (std::vector<std::string>{"ReferenceToTracker", "StylusToTracker"}));
  const auto direct = sequence->series("StylusToTracker");
  ASSERT_TRUE(direct);
  EXPECT_EQ(direct->poses.size(), 2U);
  EXPECT_EQ(direct->invalid, 1U);
  EXPECT_EQ(direct->poses[0].time_ns, 500'000'000);
  const auto chain = sequence->series("StylusToReference");
  ASSERT_TRUE(chain);
  ASSERT_EQ(chain->poses.size(), 1U) << "frame 1 has an invalid link, frame 2 no reference";
  EXPECT_EQ(chain->invalid, 2U);
  EXPECT_TRUE((chain->poses[0].pose * Vector3d(1, 0, 0)).isApprox(Vector3d(9, 19, 27), 1e-12));
  const auto inverse = sequence->series("ReferenceToStylus");
  ASSERT_TRUE(inverse);
  EXPECT_TRUE((inverse->poses[0].pose * Vector3d(9, 19, 27)).isApprox(Vector3d(1, 0, 0), 1e-12));
  EXPECT_EQ(message_after(sequence->series("ProbeToTracker"), file),
            ": no transform \"ProbeToTracker\"; the recording has ReferenceToTracker, StylusToTracker, their inverses "
            "and chains");
}

TEST(TransformSequence, ErrorsNameFileLineAndFrame) {
  const auto error_of = [](const std::string &content) {
    TemporaryFolder folder;
    const auto file = folder.write("a.igs.mha", content + kEnd);
    return message_after(read_transform_sequence(file), file);
  };
  EXPECT_EQ(error_of(kHeader + frame(0, "AToB", kIdentity) + frame(1, "AToB", "1 0 0")),
            ":6: frame 1: AToBTransform: a transform has 16 numbers, this one has 3");
  EXPECT_EQ(error_of(kHeader + frame(0, "AToB", "1 0 0 x 0 1 0 0 0 0 1 0 0 0 0 1")),
            ":3: frame 0: AToBTransform: \"x\" is not a finite number");
  EXPECT_EQ(error_of(kHeader + frame(0, "AToB", "1 0 0 0 0 2 0 0 0 0 1 0 0 0 0 1")),
            ":3: frame 0: AToBTransform: the matrix is not a rotation: its rows are not perpendicular unit vectors");
  EXPECT_EQ(error_of(kHeader + "Seq_Frame0000_AToBTransform = " + kIdentity + "\n"), ": frame 0: has no Timestamp");
  EXPECT_EQ(error_of(kHeader + "Seq_Frame0000_Timestamp = soon\n"),
            ":3: frame 0: Timestamp = soon: must be a time in seconds");
  EXPECT_EQ(error_of(kHeader + "Seq_FrameX_Timestamp = 1\n"), ":3: Seq_FrameX_Timestamp: has no frame number");
  EXPECT_NE(error_of("just text\n").find(":1: is not \"field = value\""), std::string::npos);
  EXPECT_NE(error_of(kHeader).find("holds no frames"), std::string::npos);
}

TEST(TransformSequence, AHeaderThatDoesNotEndIsNotWhole) {
  TemporaryFolder folder;
  const auto file = folder.write("a.igs.mha", kHeader + frame(0, "AToB", kIdentity));
  EXPECT_EQ(message_after(read_transform_sequence(file), file), ": is not whole: its header does not end");
}

TEST(TransformSequence, FramesAndImagesAreAsManyAsStated) {
  const std::string two = frame(0, "AToB", kIdentity) + frame(1, "AToB", kIdentity);
  const std::string other = "Seq_Frame0001_Timestamp = 2.5\n";
  for (const auto &[content, said] :
       {std::pair("DimSize = 0 0 2\n" + two + kEnd, ""),
        {"DimSize = 2 3 2\nElementType = MET_UCHAR\n" + two + kEnd + std::string(12, 'x'), ""},
        {"DimSize = 2 3 2\nElementType = MET_UCHAR\n" + two + kEnd + std::string(11, 'x'),
         ": is not whole: it holds 11 bytes of images, its header asks for 12"},
        {"CompressedData = True\nCompressedDataSize = 9\nDimSize = 2 3 2\n" + two + kEnd + std::string(8, 'x'),
         ": is not whole: it holds 8 bytes of images, its header asks for 9"},
        {"DimSize = 0 0 3\n" + two + kEnd, ": is not whole: its header has fields of 2 frames, and states 3"},
        {frame(0, "AToB", kIdentity) + frame(2, "AToB", kIdentity) + kEnd,
         ": is not whole: fields of 1 frames between the first and the last are missing"},
        {two + two + kEnd, ""},
        {two + other + kEnd, ":9: Seq_Frame0001_Timestamp: is stated before with another value"}}) {
    TemporaryFolder folder;
    const auto file = folder.write("a.igs.mha", kHeader + content);
    const auto read = read_transform_sequence(file);
    EXPECT_EQ(read ? "" : message_after(read, file), said) << content;
  }
}

TEST(TransformSequence, TheHeaderMayBeOfNrrd) {
  TemporaryFolder folder;
  std::string fields = frame(0, "AToB", kIdentity);
  for (std::size_t at = fields.find(" = "); at != std::string::npos; at = fields.find(" = ", at)) {
    fields.replace(at, 3, ":=");
  }
  const auto file =
      folder.write("a.igs.nrrd", "NRRD0004\n# Complete NRRD file format specification at:\nkinds: domain domain\n" +
                                     fields + "\n\x01\x02 pixels");
  const auto poses = read_poses(file);
  ASSERT_TRUE(poses) << poses.error().message;
  EXPECT_EQ(poses->poses.size(), 1U);
}

// Transforms that the tracker marks as invalid may have any content.
TEST(TransformSequence, InvalidFramesAreNotLookedInto) {
  TemporaryFolder folder;
  const auto sequence = read_transform_sequence(
      folder.write("a.igs.mha", kHeader + frame(0, "AToB", "nan nan", "MISSING") + frame(1, "AToB", kIdentity) + kEnd));
  ASSERT_TRUE(sequence) << sequence.error().message;
  EXPECT_EQ(sequence->series("AToB")->poses.size(), 1U);
}

TEST(TransformSequence, AFrameWithoutStatusIsNotValid) {
  TemporaryFolder folder;
  const auto sequence = read_transform_sequence(folder.write(
      "a.igs.mha", kHeader + "Seq_Frame0000_AToBTransform = " + kIdentity + "\nSeq_Frame0000_Timestamp = 1\n" + kEnd));
  ASSERT_TRUE(sequence) << sequence.error().message;
  EXPECT_EQ(sequence->series("AToB")->invalid, 1U);
}

TEST(TransformSequence, RealRecordings) {
  BREGMA_SHARED_DATA(folder, "tracker/plus");
  const std::vector<std::pair<std::string, std::size_t>> files{
      {"EightLandmarkPointsTrackedForPhantomRegistration.igs.mha", 1000},
      {"SlidingProbeTrackingData.igs.mha", 85},
      {"ReferenceToRASCalibration.igs.mha", 93},
      {"TimestampFilteringTest.igs.mha", 0},
      {"TransformInterpolationTest.igs.mha", 500},
      {"WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha", 801}};
  for (const auto &[name, frames] : files) {
    const auto sequence = read_transform_sequence(folder / name);
    ASSERT_TRUE(sequence) << sequence.error().message;
    std::printf("%s: %zu frames, %zu transforms\n", name.c_str(), sequence->frames.size(), sequence->names().size());
    EXPECT_TRUE(frames == 0 || sequence->frames.size() == frames) << name << " " << sequence->frames.size();
  }
}

} // namespace

// Operations on the head Colin27. The first is run in virtual time (display_registered_session); the second goes on from
// its registration, with the same patient, until it is stopped.
export const kSeed = 1;

const kRoom = `
[tracker]
rate_hz = 100

[patient]
camera_direction = [0.25, 0.90, -0.20]
`;

export const kRegistration = `${kRoom}
[[steps]]
do = "load_case"

[[steps]]
do = "pivot"
tool = "Stylus"
duration_s = 8

[[steps]]
do = "pivot"
tool = "Probe"
duration_s = 8

[[steps]]
do = "start_registration"

[[steps]]
do = "touch_fiducials"
tool = "Stylus"

[[steps]]
do = "trace_scalp"
tool = "Stylus"
length_mm = 800
speed_mm_s = 55

[[steps]]
do = "accept_registration"
`;

export const kNavigation = `${kRoom}
[[steps]]
do = "check_landmarks"
tool = "Stylus"

[[steps]]
do = "confirm_verification"
may_fail = true

[[steps]]
do = "start_navigation"
tool = "Probe"
trajectory = "Frontal right"

[[steps]]
do = "follow_trajectory"
tool = "Probe"
trajectory = "Frontal right"
speed_mm_s = 8
duration_s = 600
`;

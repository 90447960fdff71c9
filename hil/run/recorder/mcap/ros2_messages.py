"""ROS 2 definitions of all message types of a recording and of a live run.

The standard types are those of ROS 2 (common_interfaces, rcl_interfaces, geometry2, vision_msgs) and of Foxglove,
without their comments. The types of `hil_msgs` belong to this project; every recording contains its definitions, so
readers do not need them installed. cdr.py derives the byte layout and the schema text from this table.
"""

from __future__ import annotations

DEFINITIONS: dict[str, str] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/Bool": "bool data",
    "std_msgs/String": "string data",
    "std_srvs/SetBool_Request": "bool data",
    "std_srvs/SetBool_Response": "bool success\nstring message",
    "std_srvs/Trigger_Request": "uint8 structure_needs_at_least_one_member",
    "std_srvs/Trigger_Response": "bool success\nstring message",
    "mavros_msgs/CommandBool_Request": "bool value",
    "mavros_msgs/CommandBool_Response": "bool success\nuint8 result",
    "mavros_msgs/CommandTOL_Request": (
        "float32 min_pitch\nfloat32 yaw\nfloat32 latitude\nfloat32 longitude\nfloat32 altitude"
    ),
    "mavros_msgs/CommandTOL_Response": "bool success\nuint8 result",
    "mavros_msgs/SetMode_Request": "uint8 base_mode\nstring custom_mode",
    "mavros_msgs/SetMode_Response": "bool mode_sent",
    "std_msgs/Empty": "uint8 structure_needs_at_least_one_member",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/Vector3Stamped": "std_msgs/Header header\ngeometry_msgs/Vector3 vector",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/Imu": (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
    ),
    "sensor_msgs/MagneticField": (
        "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance"
    ),
    "sensor_msgs/FluidPressure": "std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance",
    "sensor_msgs/Temperature": "std_msgs/Header header\nfloat64 temperature\nfloat64 variance",
    "sensor_msgs/NavSatStatus": (
        "int8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 status\nuint16 SERVICE_GPS=1\nuint16 service"
    ),
    "sensor_msgs/NavSatFix": (
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\n"
        "float64 latitude\nfloat64 longitude\nfloat64 altitude\n"
        "float64[9] position_covariance\nuint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\nuint8 position_covariance_type"
    ),
    "sensor_msgs/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
        "uint32 step\nuint8[] data"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/Range": (
        "uint8 ULTRASOUND=0\nuint8 INFRARED=1\nstd_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\n"
        "float32 min_range\nfloat32 max_range\nfloat32 range\nfloat32 variance"
    ),
    "sensor_msgs/BatteryState": (
        "uint8 POWER_SUPPLY_STATUS_DISCHARGING=2\nuint8 POWER_SUPPLY_TECHNOLOGY_LIPO=3\nstd_msgs/Header header\n"
        "float32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\nfloat32 capacity\n"
        "float32 design_capacity\nfloat32 percentage\nuint8 power_supply_status\nuint8 power_supply_health\n"
        "uint8 power_supply_technology\nbool present\nfloat32[] cell_voltage\nfloat32[] cell_temperature\n"
        "string location\nstring serial_number"
    ),
    "sensor_msgs/RegionOfInterest": ("uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"),
    "sensor_msgs/CameraInfo": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\n"
        "float64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
        "sensor_msgs/RegionOfInterest roi"
    ),
    "sensor_msgs/PointField": (
        "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n"
        "uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count"
    ),
    "sensor_msgs/PointCloud2": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
        "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense"
    ),
    "radar_msgs/RadarReturn": (
        "float32 range\nfloat32 azimuth\nfloat32 elevation\nfloat32 doppler_velocity\nfloat32 amplitude"
    ),
    "radar_msgs/RadarScan": "std_msgs/Header header\nradar_msgs/RadarReturn[] returns",
    "unique_identifier_msgs/UUID": "uint8[16] uuid",
    "radar_msgs/RadarTrack": (
        "uint16 NO_CLASSIFICATION=0\nuint16 STATIC=1\nuint16 DYNAMIC=2\nunique_identifier_msgs/UUID uuid\n"
        "geometry_msgs/Point position\ngeometry_msgs/Vector3 velocity\ngeometry_msgs/Vector3 acceleration\n"
        "geometry_msgs/Vector3 size\nuint16 classification\nfloat32[6] position_covariance\n"
        "float32[6] velocity_covariance\nfloat32[6] acceleration_covariance\nfloat32[6] size_covariance"
    ),
    "radar_msgs/RadarTracks": "std_msgs/Header header\nradar_msgs/RadarTrack[] tracks",
    "rcl_interfaces/Log": (
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
        "uint32 line"
    ),
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist"
    ),
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "vision_msgs/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "vision_msgs/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox2D bbox\n"
        "string id"
    ),
    "vision_msgs/Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
    "foxglove_msgs/Point2": "float64 x\nfloat64 y",
    "foxglove_msgs/Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a",
    "foxglove_msgs/CircleAnnotation": (
        "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nfloat64 diameter\nfloat64 thickness\n"
        "foxglove_msgs/Color fill_color\nfoxglove_msgs/Color outline_color"
    ),
    "foxglove_msgs/PointsAnnotation": (
        "builtin_interfaces/Time timestamp\nuint8 LINE_LOOP=2\nuint8 type\nfoxglove_msgs/Point2[] points\n"
        "foxglove_msgs/Color outline_color\nfoxglove_msgs/Color[] outline_colors\nfoxglove_msgs/Color fill_color\n"
        "float64 thickness"
    ),
    "foxglove_msgs/TextAnnotation": (
        "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nstring text\nfloat64 font_size\n"
        "foxglove_msgs/Color text_color\nfoxglove_msgs/Color background_color"
    ),
    "foxglove_msgs/ImageAnnotations": (
        "foxglove_msgs/CircleAnnotation[] circles\nfoxglove_msgs/PointsAnnotation[] points\n"
        "foxglove_msgs/TextAnnotation[] texts"
    ),
    "hil_msgs/Detection": (
        "string label\nfloat64 score\nfloat64[4] box_px\nfloat64 range_m\nfloat64 radial_speed_mps\n"
        "geometry_msgs/Point position"
    ),
    "hil_msgs/FoundObject": (
        "uint32 number\nstring label\nbuiltin_interfaces/Time last_seen\ngeometry_msgs/Point position\n"
        "geometry_msgs/Vector3 velocity\nuint32 sightings\nfloat64 sigma_m"
    ),
    "hil_msgs/Detections": (
        "std_msgs/Header header\nstring topic\nuint32 width\nuint32 height\nhil_msgs/Detection[] detections\n"
        "hil_msgs/FoundObject[] objects"
    ),
    "hil_msgs/PressureAltitude": "std_msgs/Header header\nfloat64 altitude_m",
    "hil_msgs/GpsQuality": (
        "std_msgs/Header header\nfloat64 horizontal_accuracy_m\nfloat64 vertical_accuracy_m\n"
        "uint8 fix_type\nuint8 satellites"
    ),
    "hil_msgs/GnssSky": (
        "std_msgs/Header header\nfloat64 hdop\nfloat64 vdop\nfloat64 pdop\nuint8 in_view\nuint8 visible\n"
        "uint8 used\nuint8 reflected\nfloat64 mean_cn0_dbhz\nfloat64 jamming_db\nbool spoofed\n"
        "geometry_msgs/Vector3 shift"
    ),
    "hil_msgs/Range": (
        "std_msgs/Header header\nfloat64 distance_m\nfloat64 min_distance_m\nfloat64 max_distance_m\n"
        "float64 sigma_m\nuint8 quality\ngeometry_msgs/Vector3 axis"
    ),
    "hil_msgs/DifferentialPressure": "std_msgs/Header header\nfloat64 differential_pressure_pa",
    "hil_msgs/AirVane": "std_msgs/Header header\nfloat64 angle_of_attack_rad\nfloat64 sideslip_rad",
    "hil_msgs/Scalar": "std_msgs/Header header\nfloat64 value",
    "hil_msgs/OpticalFlow": (
        "std_msgs/Header header\nint64 integration_ns\nfloat64[2] flow_rad\nfloat64[3] gyro_rad\n"
        "float64 distance_m\nuint8 quality"
    ),
    "hil_msgs/RadarFrame": (
        "std_msgs/Header header\n"
        "float64 center_frequency_hz\nfloat64 bandwidth_hz\nfloat64 sample_rate_hz\nfloat64 repetition_s\n"
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
        "uint32 receivers\nuint32 chirps\nuint32 samples\nuint16[] data"
    ),
    "hil_msgs/RotorSpeeds": "std_msgs/Header header\nfloat64[] speed_radps",
    "hil_msgs/SurfaceAngles": "std_msgs/Header header\nfloat64[] angle_rad",
    "hil_msgs/AirData": (
        "std_msgs/Header header\nfloat64 airspeed_mps\nfloat64 angle_of_attack_rad\nfloat64 sideslip_rad"
    ),
    "hil_msgs/Contact": "std_msgs/Header header\nbool in_contact",
    "hil_msgs/ActuatorControls": "std_msgs/Header header\nfloat64[] controls\nbool armed\nuint8 mode",
    "hil_msgs/MavlinkFrame": "builtin_interfaces/Time stamp\nuint32 msgid\nuint8[] data",
}

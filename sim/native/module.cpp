// nanobind entry point of sim._kernels: one bind_* function per kernel file.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

void bind_actors(nb::module_ &m);
void bind_body(nb::module_ &m);
void bind_dataset_pictures(nb::module_ &m);
void bind_dryden(nb::module_ &m);
void bind_extinction(nb::module_ &m);
void bind_frame(nb::module_ &m);
void bind_gait(nb::module_ &m);
void bind_gnss(nb::module_ &m);
void bind_ideal_controller(nb::module_ &m);
void bind_image_noise(nb::module_ &m);
void bind_imu(nb::module_ &m);
void bind_lidar_drops(nb::module_ &m);
void bind_lidar_receiver(nb::module_ &m);
void bind_radar_mirrors(nb::module_ &m);
void bind_radar_scatterers(nb::module_ &m);
void bind_radar_receiver(nb::module_ &m);
void bind_radar_synthesis(nb::module_ &m);
void bind_rain_streaks(nb::module_ &m);
void bind_ray(nb::module_ &m);
void bind_ray_cast(nb::module_ &m);
void bind_sweep_rays(nb::module_ &m);

NB_MODULE(_kernels, m) {
    m.doc() = "Simulation kernels: plain views in, caller-owned arrays out; long calls release the GIL.";
    bind_actors(m);
    bind_body(m);
    bind_dataset_pictures(m);
    bind_dryden(m);
    bind_extinction(m);
    bind_frame(m);
    bind_gait(m);
    bind_gnss(m);
    bind_ideal_controller(m);
    bind_image_noise(m);
    bind_imu(m);
    bind_lidar_drops(m);
    bind_lidar_receiver(m);
    bind_radar_mirrors(m);
    bind_radar_scatterers(m);
    bind_radar_receiver(m);
    bind_radar_synthesis(m);
    bind_rain_streaks(m);
    bind_ray(m);
    bind_ray_cast(m);
    bind_sweep_rays(m);
}

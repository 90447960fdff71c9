// The newest values of sensors that give numbers, one line each.

import { number } from "/page/tables.js";

const FIX = ["no GPS", "no fix", "2-D fix", "3-D fix", "DGPS", "RTK float", "RTK fixed"];

// `sample`: fields as the bench names them, units in the name.
export function sensorRows(sensors) {
  return Object.entries(sensors ?? {}).sort(([a], [b]) => a.localeCompare(b)).map(([name, sample]) => [name, words(sample)]);
}

function words(s) {
  const vector = (v, unit, digits = 2) => `${v.map((one) => number(one, digits)).join(", ")} ${unit}`;
  if (s.accel_mps2) return `${vector(s.accel_mps2, "m/s²")}; ${vector(s.gyro_radps, "rad/s")}`;
  if (s.field_tesla) return vector(s.field_tesla.map((v) => v * 1e6), "µT", 1);
  if (s.pressure_altitude_m !== undefined) return `${number(s.pressure_pa / 100, 2)} hPa, ${number(s.pressure_altitude_m)} m`;
  if (s.fix_type !== undefined)
    return `${FIX[s.fix_type] ?? s.fix_type}, ${s.satellites} satellites, ±${number(s.horizontal_accuracy_m)} m; ${s.latitude_deg?.toFixed(6)}°, ${s.longitude_deg?.toFixed(6)}°, ${number(s.altitude_m)} m`;
  if (s.flow_rad) return `${vector(s.flow_rad, "rad", 3)}, quality ${s.quality}`;
  if (s.distance_m !== undefined) return s.quality ? `${number(s.distance_m)} m` : "nothing in reach";
  return "";
}

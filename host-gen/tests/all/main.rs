//! Everything about the library that takes more than one of its modules, in one program:
//! machines, searches and reports that several tests look at are made once.

mod actuators;
mod analysis;
mod bad_files;
mod beams_with_mass;
mod cases;
mod channel_gains;
mod common;
mod edits;
mod flexible_bodies;
mod identification;
mod kept_searches;
mod link_without_answer;
mod loads;
mod measuring_amplitude;
mod metrology_frame;
mod modal_law;
mod odd_machines;
mod other_machines;
mod outline;
mod parts;
mod passive_machines;
mod records;
mod report;
mod robustness;
mod sampled_loop;
mod sensor_dynamics;
mod sensor_noise;
mod soft_start;
mod spectrum;
mod springs_and_joints;
mod tilt;

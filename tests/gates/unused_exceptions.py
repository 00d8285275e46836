"""Code that nothing in the shipped packages calls by its name, and that stays: each with the reason. For vulture.

Tests are no callers. A test holds that every name here is one that vulture would report: what is deleted, or is called
again, leaves this list.
"""

# Named by a library or a protocol, which calls or reads them.
_.mtime  # tarfile: bundles are equal to the byte
_.gname
_.uname
_.mlen  # pymavlink's header
_.compat_flags
_.srcSystem
_.srcComponent
_.satellites_visible  # MAVLink messages of GNSS receivers
_.generating_software  # laspy's header
_.creation_date
_.scales
_.wkt
_.daemon_threads  # socketserver
_.block_on_close
_.allow_reuse_address
_.request_queue_size
_.handle_error
_.server_version  # http.server
_.sys_version
_.do_GET
_.do_POST
_.close_connection
_.handle
_.log_message
_.writable  # io
_.description  # argparse
_.formatter_class
_.text_factory  # sqlite3
_.on_broken_pipe  # rich
_._repr_html_  # notebooks
_.nullable_schema  # pydantic: how JSON Schema is generated
_.field_title_should_be_set
cover  # a law's, of the example: called by its name
Here  # the site: its page's worker calls it by its name, in the browser
Rangefinder  # of the example packages: named by their entry points
RangefinderModel
MEADOW
__getattr__  # Python: of a module whose parts are imported when they are asked for

# Read from outside, as JSON or text, by their names: fields of what is written.
_.time_utc  # preflight's report
_.corners_deg
_.size_px
_.attribution
_.not_heard  # watch: what the page is told of a swarm
_.schema_version  # of a mission or a study: the reader checks it
_.localise  # the same, of a study of localisation
_.drift_mps  # of a fault: the numbers of its kind are read by the names in its row
_.jump_m  # the same
_.PARALLEL  # values of an enumeration that files give
_.CANCELLED  # MAV_RESULT: an autopilot answers it
_.TRACK
_.PAYLOAD
_.FENCE_ALT_MIN  # FENCE_TYPE: its bit is taken, or the next would be named wrongly

# Figures: their tables are read by `fields` or `_fields`, never by one name.
_.overshoot  # of a velocity step
_.settled_error
_.straight_time_s  # of a flight
_.arrival_leader_s
_.overhead_leader
_.overhead_last
_.speed_mean_transit_mps
_.connected_fraction_coverage
_.splits
_.longest_gap_s
_.rejoin_s
_.lambda2_mean_transit
_.vertex_connectivity_coverage
_.coverage_settled_s
_.acting_leaders_max
_.acting_leaders_overlap_s
_.leader_changes
_.leaderless_max_s
_.relative_error_m  # of recorded estimates
_.relative_error_sds
_.estimate_error_rms_m
_.estimate_error_max_m
_.estimate_height_error_max_m
_.estimate_yaw_error_max_deg
_.stems_passed  # of surveys
_.stems_found
_.stems_found_share
_.stems_measured
_.stems_false_share
_.stems_dbh_rmse_m
_.stems_dbh_bias_m
_.stems_dbh_within_share
_.stems_breast_share
_.stems_position_rmse_m
_.stems_relative_rmse_m
_.leader_error_d2_m
_.handover_jump_m
_.handover_step_mps
_.over_alone_leader  # of a study
_.over_alone_last
_.acceleration_mean_mps2
_.connected_disc
_.connected_attenuated
_.connected_cut
_.vehicle_s
_.p95

# Called or read by tests alone, for a reason.
_.causal_m  # the bounds that a study's estimator is held to
_.smoothed_m
LITERAL  # Algorithm 1 as it is printed: a test shows that it does not fly
LawModule  # what a law's module has to offer: for those who write one
read_column  # what the replay's page does with a column, in Python: tests compare the two
read_steps
_.EXIT_FAILED  # a board's test ends with it
_.setpoints_rejected  # of a simulated autopilot, whose refusals have no message

# To be deleted or shown by those who rewrite these parts.
_.setpoint_ned_mps
_.unsent

"""In a swarm with keys records reach the base station as they do in one without: the same tests, with signatures."""

from __future__ import annotations

import pytest

from companion.records.signed.keys import RecordKeys
from tests.unit.records import records_kit
from tests.unit.records.signed_kit import keys_of
from tests.unit.records.test_exchange import (  # noqa: F401
    test_a_base_station_with_a_new_file_is_sent_all_again,
    test_a_disk_that_lost_the_end_of_its_log_gives_no_number_twice,
    test_a_restarted_base_station_asks_for_nothing_twice,
    test_a_restarted_vehicle_goes_on_in_its_log,
    test_a_split_is_made_up_for,
    test_a_vehicle_that_falls_has_left_its_records_with_the_others,
    test_a_vehicle_that_lost_its_disk_begins_another_log_and_duplicates_nothing,
    test_all_records_reach_the_base_station_once,
    test_neighbours_do_not_all_send_the_same_record,
    test_records_travel_over_others_and_so_does_their_acknowledgement,
    test_the_base_station_is_served_before_others,
    test_thirty_percent_of_loss_is_repaired,
    test_what_only_a_fallen_vehicle_had_is_known_to_be_missing_and_hides_nothing,
)
from tests.unit.records.test_exchange_disks import (  # noqa: F401
    test_a_disk_of_the_base_station_that_takes_nothing_is_said_once_and_made_up_for,
    test_a_full_base_station_says_so_and_gets_the_rest_when_it_has_room,
    test_a_full_vehicle_passes_on_what_it_has_and_deletes_only_what_is_delivered,
    test_no_record_is_told_of_or_sent_before_it_is_on_the_disk,
)


@pytest.fixture(autouse=True)
def _with_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    def keys(me: int, mission_hash: int) -> RecordKeys:
        return keys_of(me, mission_hash=mission_hash)

    monkeypatch.setattr(records_kit, "KEYS", keys)

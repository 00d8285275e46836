"""Rotation of a fleet whose members have files of different steps: nobody is lost, and one that is revoked is out."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.keys.key_file import parse_keyring, render_keyring
from companion.keys.keyring import OPERATOR, Keyring
from companion.keys.rotation import Step, advance, finish, is_newer, newest, revoke, step_of
from tests.unit.keys.keys_kit import operator_of, random_bytes, vehicle_of

SIZE = 4


class Field:
    """A fleet, its folder, and those that are revoked, with every secret that they ever had."""

    def __init__(self, first_epoch: int) -> None:
        self.folder = operator_of(SIZE, (first_epoch,))
        self.installed = dict.fromkeys((OPERATOR, *self.folder.vehicles), self.folder)
        self.seen = {member: set(self.folder.secrets.values()) for member in self.installed}
        self.revoked: set[int] = set()
        self._drawn = 0

    def fresh(self) -> bytes:
        self._drawn += 1
        return random_bytes("fresh", self._drawn)

    @property
    def is_installed(self) -> bool:
        return all(keyring == self.folder for keyring in self.installed.values())

    def install(self, member: int) -> None:
        """Any member, at any time: the file that the folder has now."""
        if member in self.installed:
            self.installed[member] = self.folder
            self.seen[member] |= set(self.folder.secrets.values())

    def rotate(self) -> None:
        """As the command says: when all have the files of the step before."""
        if self.is_installed:
            self.folder = advance(self.folder, self.fresh())

    def revoke(self, vehicle: int) -> None:
        """At any time, but for the second step, which all must have first."""
        if vehicle in self.folder.vehicles and len(self.folder.vehicles) > 1:
            if step_of(self.folder) is Step.NEW_ACTIVE:
                self.install_all()
            self.folder = revoke(self.folder, vehicle, self.fresh())
            del self.installed[vehicle]
            self.revoked.add(vehicle)

    def install_all(self) -> None:
        for member in self.installed:
            self.install(member)

    def lost(self) -> list[tuple[int, int]]:
        """Pairs of which the first does not accept what the second sends."""
        return [
            (ear, mouth)
            for ear, hearing in self.installed.items()
            for mouth, sending in self.installed.items()
            if not accepts(hearing, sending.active, sending.secrets[sending.active])
        ]

    def accepted_of_revoked(self) -> list[tuple[int, int]]:
        """Members that take a frame which a revoked vehicle can sign, or its own signature."""
        return [
            (member, gone)
            for member, keyring in self.installed.items()
            for gone in self.revoked
            if gone in keyring.vehicles or self.seen[gone] & set(keyring.secrets.values())
        ]


def accepts(keyring: Keyring, epoch: int, secret: bytes) -> bool:
    return keyring.secrets.get(epoch) == secret


actions = st.lists(
    st.one_of(
        st.tuples(st.just("install"), st.integers(0, SIZE)),
        st.tuples(st.just("install_all")),
        st.tuples(st.just("rotate")),
        st.tuples(st.just("rotate")),
        st.tuples(st.just("revoke"), st.integers(1, SIZE)),
    ),
    max_size=40,
)


def play(field: Field, action: tuple[str, *tuple[int, ...]]) -> None:
    name, *arguments = action
    getattr(field, name)(*arguments)


@settings(max_examples=200)
@given(first_epoch=st.integers(0, 255), played=actions)
def test_nobody_is_lost_however_steps_are_installed(first_epoch, played):
    field = Field(first_epoch)
    for action in played:
        play(field, action)
        assert field.lost() == []
        assert 1 <= len(field.folder.secrets) <= 2
        for vehicle in field.folder.vehicles:
            keyring = vehicle_of(field.folder, vehicle)
            assert parse_keyring(render_keyring(keyring), "x") == keyring


@settings(max_examples=200)
@given(first_epoch=st.integers(0, 255), played=actions, order=st.permutations(range(SIZE + 1)))
def test_revoked_vehicle_is_out_when_the_rotation_is_finished_and_nobody_else_is(first_epoch, played, order):
    field = Field(first_epoch)
    for action in played:
        play(field, action)
    assume(field.revoked)
    for _ in range(4):
        for member in order:
            field.install(member)
            assert field.lost() == []
        if step_of(field.folder) is Step.REST:
            break
        field.rotate()
    assert step_of(field.folder) is Step.REST
    assert field.accepted_of_revoked() == []
    assert field.installed.keys() == {OPERATOR, *range(1, SIZE + 1)} - field.revoked
    assert field.lost() == []


@given(first_epoch=st.integers(0, 255), played=actions)
def test_finish_at_once_leaves_one_secret_that_no_revoked_vehicle_has(first_epoch, played):
    field = Field(first_epoch)
    for action in played:
        play(field, action)
    field.install_all()
    was = field.folder
    field.folder = finish(field.folder, field.fresh())
    field.install_all()
    assert len(field.folder.secrets) == 1
    assert field.accepted_of_revoked() == []
    assert field.lost() == []
    assert (field.folder.secrets == was.secrets) is False


@given(first_epoch=st.integers(0, 255), played=actions)
def test_what_a_step_makes_is_newer_and_what_it_was_made_of_is_not(first_epoch, played):
    field = Field(first_epoch)
    for action in played:
        was = field.folder
        play(field, action)
        ended = finish(field.folder, field.fresh())
        for later, earlier in ((field.folder, was), (ended, field.folder)):
            assert is_newer(later, earlier) is (later != earlier)
            assert not is_newer(earlier, later)
        assert not is_newer(was, ended)


@given(first_epoch=st.integers(0, 255))
def test_three_runs_are_a_rotation_and_the_step_is_told_by_the_file_alone(first_epoch):
    keyring = operator_of(SIZE, (first_epoch,))
    steps = []
    for number in range(6):
        steps.append(step_of(keyring))
        shuffled = replace(keyring, secrets=dict(reversed(keyring.secrets.items())))
        assert (step_of(shuffled), newest(shuffled)) == (step_of(keyring), newest(keyring))
        keyring = advance(keyring, random_bytes(number))
    assert steps == [Step.REST, Step.NEW_ACCEPTED, Step.NEW_ACTIVE] * 2
    assert (keyring.active - first_epoch) % 256 == 2


def test_model_sees_one_that_is_lost_and_one_that_is_not_out():
    field = Field(0)
    field.folder = advance(advance(field.folder, field.fresh()), field.fresh())  # two steps, and nothing between
    field.install(1)
    assert (2, 1) in field.lost()
    field = Field(0)
    field.revoke(3)
    assert (1, 3) in field.accepted_of_revoked()

"""What real clients wait for beyond the protocol, each found by flying with one (`tests/clients`)."""

from __future__ import annotations

from link_station import expect, stock_client

from avionics.link.dialect import mavlink


def test_the_error_comes_before_the_value_so_that_mavsdk_does_not_set_it_again() -> None:
    with stock_client() as (client, vehicle):
        client.mav.param_set_send(1, 1, b"PITCH_P", 99.0, mavlink.MAV_PARAM_TYPE_REAL32)
        kinds = [expect(client, ["PARAM_ERROR", "PARAM_VALUE"]).get_type() for _ in range(2)]
        assert kinds == ["PARAM_ERROR", "PARAM_VALUE"]
        assert vehicle.parameters[0].value == 0.8

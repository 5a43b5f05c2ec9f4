"""The sensors' constant errors."""

from dataclasses import replace

import numpy as np

from glassgait.models.estimation.imu import ImuErrors
from glassgait.models.task.randomization import NOMINAL
from glassgait.systems.sensor_bias import SensorBias

ERRORS = replace(
    NOMINAL, encoder_bias=0.02, imu=ImuErrors(gyroscope_bias=0.1, accelerometer_bias=0.5)
)


def drawn(system, context):
    return (
        system.get_encoder_bias_output_port().Eval(context),
        system.get_imu_bias_output_port().Eval(context),
    )


def test_biases_stay_within_the_greatest_and_are_the_seeds(fix_inputs):
    system = SensorBias(ERRORS)
    encoders, imu = map(
        np.array,
        zip(*(drawn(system, fix_inputs(system, seed=own)) for own in range(200)), strict=True),
    )
    assert encoders.shape == (200, 12) and imu.shape == (200, 9)
    assert 0.019 < np.abs(encoders).max() <= 0.02
    np.testing.assert_allclose(np.abs(imu).max(axis=0), ERRORS.imu.half_widths, rtol=0.05)
    assert not imu[:, 6:].any()
    np.testing.assert_array_equal(drawn(system, fix_inputs(system, seed=7))[0], encoders[7])


def test_they_hold_as_time_goes_on_and_clones_have_their_own(fix_inputs):
    system = SensorBias(ERRORS)
    context = fix_inputs(system, seed=0.3)
    first = drawn(system, context)
    clone = fix_inputs(system, context.Clone(), seed=0.4)
    context.SetTime(123.0)
    np.testing.assert_array_equal(drawn(system, context)[1], first[1])
    assert np.all(drawn(system, clone)[1][:6] != first[1][:6])


def test_sensors_without_biases_have_none(fix_inputs):
    system = SensorBias(NOMINAL)
    assert not any(own.any() for own in drawn(system, fix_inputs(system, seed=1.0)))

defmodule @MODULE@Test do
  use ExUnit.Case

  # Robots that die are planned.
  @moduletag :capture_log

  test "a team goes round" do
    assert {:ok, %{violations: [], ending: :done}} =
             :starl_sim_trial.run(%{app: @MODULE@, robots: 3, seed: 1})
  end

  test "teams of all sizes keep their contracts under faults" do
    for seed <- 1..20 do
      scenario = %{app: @MODULE@, robots: 1 + rem(seed, 6), seed: seed, random_faults: [:all], time: 600}
      assert {^seed, {:ok, %{violations: []}}} = {seed, :starl_sim_trial.run(scenario)}
    end
  end
end

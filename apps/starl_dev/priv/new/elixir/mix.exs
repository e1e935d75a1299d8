defmodule @MODULE@.MixProject do
  use Mix.Project

  def project do
    [
      app: :@NAME@,
      version: "0.1.0",
      deps: [{:starl, git: "@URL@", @MIX_VERSION@}]
    ]
  end

  def application, do: [extra_applications: [:logger]]
end
